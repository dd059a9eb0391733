// The probability that the best of some poses is right (docs/method.md, section 7).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "firstfix/query/ranking.hpp"

namespace firstfix {

// Features of one pose among those that compete. tied: number of poses that tie, this one included.
struct MatchFeatures {
  Fit fit;
  double margin;  // of the support over that of the best pose that does not tie with it
  std::size_t tied;
};

// What is known of a pose by its support among those of all that compete, (count,). Poses tie if their support differs by
// less. If several poses compete and all of them tie, the best rival was not compared: then the margin is the lead over the
// weakest one.
inline MatchFeatures match_features(const Fit& fit, const std::vector<double>& supports, std::size_t number, double tied_within,
                                    double max_margin) {
  const double own = supports[number];
  tied_within = std::max(tied_within, std::numeric_limits<double>::denorm_min());
  std::size_t rivals = 0;
  double best_rival = -std::numeric_limits<double>::infinity(), least = std::numeric_limits<double>::infinity();
  for (const double support : supports) {
    least = std::min(least, support);
    if (std::fabs(support - own) < tied_within) continue;
    best_rival = std::max(best_rival, support);
    ++rivals;
  }
  const double margin = supports.size() == 1 ? max_margin : own - (rivals > 0 ? best_rival : least);
  return {fit, margin, supports.size() - rivals};
}

// Inputs of the logistic model (equation 7.2). A larger value never lowers the probability. A removed surface does not count
// here, but in the margin: things leave, wherever the scan was taken. What is not contradicted counts as far as the scan meets
// the map.
inline std::array<double, 5> inputs_of(const MatchFeatures& features, const ProbabilityNumbers& numbers) {
  const Fit& fit = features.fit;
  const double met = fit.meets_map();
  return {std::log((numbers.worst_score + fit.alignment_score) / (numbers.best_score - fit.alignment_score)),
          -met * std::log(numbers.violation_offset + fit.free_space_violation),
          -met * std::log(numbers.beside_offset + fit.beside_surface),
          -met * std::log(numbers.same_plane_offset + fit.same_plane),
          std::min(features.margin, numbers.max_margin)};
}

// firstfix.engine.calibration.Calibration, under the same names.
struct Calibration {
  using Model = std::array<double, 6>;  // bias, alignment_score, free_space, beside_surface, same_plane, margin

  Model model;
  std::optional<Model> among_tied;
  double min_probability, search_until, min_inlier_ratio, max_free_space_violation, min_margin, alias_margin;
  bool is_prior;  // fitted on no case of its own

  // Probability, 0..1, that the pose or one that ties with it is right.
  double probability(const MatchFeatures& features, const ProbabilityNumbers& numbers) const {
    const Model& weights = features.tied > 1 && among_tied ? *among_tied : model;
    const std::array<double, 5> inputs = inputs_of(features, numbers);
    double odds = 0;
    for (std::size_t k = 0; k < 5; ++k) odds += inputs[k] * weights[k + 1];
    odds += weights[0];
    return 1 / (1 + std::exp(-std::min(std::max(odds, -50.0), 50.0)));
  }

  // The probability that the pose has at most, whatever its rivals.
  double most(const Fit& fit, const ProbabilityNumbers& numbers) const {
    return std::max(probability({fit, numbers.max_margin, 1}, numbers), probability({fit, numbers.max_margin, 2}, numbers));
  }

  // Whether the verdict may be `localized`.
  bool accepts(const MatchFeatures& features, const ProbabilityNumbers& numbers, double needed) const {
    return features.fit.inlier_ratio >= min_inlier_ratio && features.fit.free_space_violation <= max_free_space_violation &&
           features.tied == 1 && probability(features, numbers) >= needed;
  }

  // Whether a pose is so surely right that nothing else is searched for.
  bool ends_search(const MatchFeatures& features, const ProbabilityNumbers& numbers) const {
    return accepts(features, numbers, search_until);
  }
};

}  // namespace firstfix
