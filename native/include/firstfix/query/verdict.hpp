// From ranked poses, of one map or several, to an answer, or to the reason why there is none (docs/method.md section 7).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "firstfix/query/calibration.hpp"
#include "firstfix/query/ranking.hpp"

namespace firstfix {

// Probability that a scan in motion needs, at least and at most. Below the first, two of 3,420 were localized wrongly; no moving
// scan of another office reached the second (lab/docs/experiments.md, "Robots in motion among look-alikes").
constexpr double kInMotionLeast = 0.997, kInMotionMost = 0.999;
// Of support, to each side of the lead from which a place no longer ties. Points rounded to a centimetre move leads by about half
// of it: a place that is just within would add .16 to the probability, and then not.
constexpr double kBlur = 0.01;
// Of support: a place that is so far behind leads in another encoding of the scan e times less often than the best one. Points
// rounded to a centimetre move the support of places by 0.009 to 0.019 (standard deviation).
constexpr double kRounding = 0.02;
// Best places whose agreement is measured with many points where they may tie: those that a search aligns finely.
constexpr std::size_t kMeasuredFinely = 3;

// The numbers of one map by which its poses are judged.
struct JudgingMap {
  ProbabilityNumbers ranking;
  Calibration calibration;
};

// A pose that competes for the answer, in one of several maps.
struct Competitor {
  std::size_t map;  // which of the maps
  Fit fit;
  double support;
  std::size_t spots;  // where the query's scans were taken
  bool is_alike;      // whether the scan does not tell it from the best pose of its map
  double outside_lead;  // of support, by which a known alias outside the query's prior is better; 0: none is
  bool rests, is_in_motion;
};

enum class Why {
  kLocalized,
  kNoCandidate,
  kLowInlierRatio,
  kFreeSpaceViolation,
  kLowProbability,
  kNotConverged,
  kSeveralPlaces,  // the verdict is then "ambiguous", and "rejected" for those above
};

// The code of firstfix.answer.localization.Reason; nothing: localized.
inline std::optional<std::string> code_of(Why why) {
  switch (why) {
    case Why::kLocalized: return std::nullopt;
    case Why::kNoCandidate: return "no_candidate";
    case Why::kLowInlierRatio: return "low_inlier_ratio";
    case Why::kFreeSpaceViolation: return "free_space_violation";
    case Why::kLowProbability: return "low_probability";
    case Why::kNotConverged: return "not_converged";
    case Why::kSeveralPlaces: return "several_places";
  }
  return std::nullopt;
}

// shares: probability of each pose.
struct Decision {
  Why why;
  double probability;
  std::vector<double> shares;
};

// Decides on poses that are distinct, best first. Each is judged by the calibration of its own map.
class Judge {
 public:
  // maps, ranked: must outlive it.
  Judge(const std::vector<JudgingMap>& maps, const std::vector<Competitor>& ranked) : maps_(maps), ranked_(ranked) {
    for (const Competitor& one : ranked) supports_.push_back(one.support);
  }

  // asked: the threshold on the probability that the caller asks for; not a number: none.
  Decision decided(double asked) const {
    if (ranked_.empty()) return {Why::kNoCandidate, 0, {}};
    const Competitor& best = ranked_.front();
    const JudgingMap& map = map_of(best);
    const MatchFeatures features = features_of(0);
    double probability = map.calibration.probability(features, map.ranking);
    Why why = why_not_localized(features, map, needed(map.calibration, best.is_in_motion, asked));
    // a better place is known, and the prior excludes it
    if ((why == Why::kLocalized || why == Why::kSeveralPlaces) && is_better_outside(best)) why = Why::kLowProbability;
    if (why == Why::kLocalized && !best.rests) why = Why::kNotConverged;
    if (why == Why::kSeveralPlaces) probability = of_several(features);
    return {why, probability, shares(features.tied, probability)};
  }

  // The probability from which on a pose is accepted. What many maps have taught, they taught of scans at rest. One in motion
  // fits wrong places better: it needs more, and how much more, the map's own cases say.
  static double needed(const Calibration& calibration, bool is_in_motion, double asked) {
    if (!std::isnan(asked)) return asked;
    if (!is_in_motion) return calibration.min_probability;
    return std::max({calibration.min_probability, kInMotionLeast, std::min(calibration.search_until, kInMotionMost)});
  }

  // Features of one of the poses. Support is a mean over the scans, so the margin counts once for each spot. Poses that are alike
  // tie, and so do all that the scan fits better than one of these. Places outside a prior are rivals only if they are better:
  // which of those that tie is right, the prior says.
  MatchFeatures features_of(std::size_t number) const {
    const Competitor& one = ranked_[number];
    const JudgingMap& map = map_of(one);
    double tied_within = map.calibration.min_margin;
    for (std::size_t i = 0; number == 0 && i < ranked_.size(); ++i) {
      if (ranked_[i].is_alike && ranked_[i].map == one.map) tied_within = std::max(tied_within, beyond(i));
    }
    MatchFeatures features = match_features(one.fit, supports_, number, tied_within, map.ranking.max_margin);
    if (is_better_outside(one)) features.margin = std::min(features.margin, -one.outside_lead);
    if (one.spots != 1) features.margin *= static_cast<double>(one.spots);
    return features;
  }

 private:
  const JudgingMap& map_of(const Competitor& one) const { return maps_[one.map]; }

  bool is_better_outside(const Competitor& one) const { return one.outside_lead >= map_of(one).calibration.alias_margin; }

  // A difference of support just beyond that of a pose and the best one.
  double beyond(std::size_t number) const {
    return std::nextafter(std::fabs(supports_[number] - supports_[0]), std::numeric_limits<double>::infinity());
  }

  static Why why_not_localized(const MatchFeatures& best, const JudgingMap& map, double needed) {
    const auto& [ranking, calibration] = map;
    if (best.fit.inlier_ratio < calibration.min_inlier_ratio) return Why::kLowInlierRatio;
    if (best.fit.free_space_violation > calibration.max_free_space_violation) return Why::kFreeSpaceViolation;
    if (calibration.accepts(best, ranking, needed)) return Why::kLocalized;
    if (best.tied > 1 && calibration.probability(best, ranking) >= ranking.likely) return Why::kSeveralPlaces;
    const MatchFeatures alone{best.fit, ranking.max_margin, 1};
    if (calibration.accepts(alone, ranking, std::max(needed, calibration.search_until))) return Why::kSeveralPlaces;
    MatchFeatures unopposed = best;
    unopposed.fit.free_space_violation = 0;
    if (calibration.probability(unopposed, ranking) >= needed) return Why::kFreeSpaceViolation;
    return Why::kLowProbability;
  }

  // Probability that one of the places that tie is right, blurred over where a tie ends. Each number of places counts as far as
  // the next one's lead is beyond the end. So the same scan in another encoding, whose leads differ by little, has nearly the
  // same probability. features: of the best one.
  double of_several(const MatchFeatures& features) const {
    const Competitor& best = ranked_.front();
    const Calibration& calibration = map_of(best).calibration;
    std::vector<double> leads;
    for (const double support : supports_) leads.push_back(supports_.front() - support);
    std::sort(leads.begin(), leads.end());
    const double furthest = leads[features.tied - 1];
    // known aliases tie further than others, and surely
    const double end = furthest < calibration.min_margin ? calibration.min_margin : furthest + kBlur;
    std::vector<double> ties{1};
    for (std::size_t i = 1; i < leads.size(); ++i) {
      ties.push_back(std::min(std::max((end + kBlur - leads[i]) / (2 * kBlur), 0.0), 1.0));
    }
    ties.push_back(0);
    double probability = 0;
    for (std::size_t tied = 1; tied < ties.size(); ++tied) {
      const double share = ties[tied - 1] - ties[tied];
      if (!(share > 0)) continue;
      const double lead = static_cast<double>(best.spots) * leads[std::min(tied, leads.size() - 1)];
      probability += share * of_tied(tied, leads.size() > 1 ? lead : features.margin);
    }
    return probability;
  }

  // Probability that one of the first places is right, which tie and lead over the others by a margin: by the fit of each of them,
  // weighted by the chance that it leads. Which one does, rounding decides.
  double of_tied(std::size_t tied, double margin) const {
    double sum = 0, weights = 0;
    for (std::size_t i = 0; i < std::min(tied, kMeasuredFinely); ++i) {
      const auto& [ranking, calibration] = map_of(ranked_[i]);
      const double weight = std::exp((supports_[i] - supports_.front()) / kRounding);
      sum += weight * calibration.probability({ranked_[i].fit, margin, tied}, ranking);
      weights += weight;
    }
    return sum / weights;
  }

  // Equal for those that tie; others get at most the remainder.
  std::vector<double> shares(std::size_t tied, double probability) const {
    std::vector<double> made(tied, probability / static_cast<double>(tied));
    for (std::size_t i = tied; i < ranked_.size(); ++i) {
      const JudgingMap& map = map_of(ranked_[i]);
      made.push_back(std::min(map.calibration.probability(features_of(i), map.ranking), 1 - probability));
    }
    return made;
  }

  const std::vector<JudgingMap>& maps_;
  const std::vector<Competitor>& ranked_;
  std::vector<double> supports_;
};

}  // namespace firstfix
