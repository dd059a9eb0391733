// A map's numbers and a pose's quality, as Python has them: objects whose attributes have the names of the fields.
#pragma once

#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "arrays.hpp"
#include "firstfix/query/calibration.hpp"
#include "firstfix/query/ranking.hpp"
#include "firstfix/query/searched_map.hpp"

namespace firstfix::python {

constexpr int kMostIterations = 1000;  // a caller's slip must not keep a thread for hours
constexpr double kMostCount = 1e6;

inline double number(nb::handle config, const char* name) {
  double value = 0;
  if (!nb::hasattr(config, name) || !nb::try_cast(config.attr(name), value)) throw nb::type_error("it lacks a number");
  require(std::isfinite(value), "a number of the map is not finite");
  return value;
}

inline double positive(nb::handle config, const char* name) {
  const double value = number(config, name);
  require(value > 1e-9 && value < 1e9, "a number of the map is not positive, or too large");
  return value;
}

inline std::size_t count(nb::handle config, const char* name) {
  const double value = number(config, name);
  require(value >= 0 && value <= kMostCount, "a count of the map is negative or too large");
  return static_cast<std::size_t>(value);
}

inline int iterations(nb::handle config, const char* name) {
  const double value = number(config, name);
  require(value >= 0 && value <= kMostIterations, "there must be 0 to 1000 iterations");
  return static_cast<int>(value);
}

inline Vector6 six(nb::handle numbers) {
  std::vector<double> values;
  require(nb::try_cast(numbers, values) && values.size() == 6, "there are not six numbers");
  Vector6 made;
  std::copy(values.begin(), values.end(), made.begin());
  return made;
}

inline void take_support(nb::handle c, SupportNumbers& to) {
  to.alignment_weight = number(c, "alignment_weight"), to.removed_weight = number(c, "removed_weight");
  to.violation_weight = number(c, "violation_weight"), to.seen_free_weight = number(c, "seen_free_weight");
  to.seen_free_offset = positive(c, "seen_free_offset"), to.best_score = number(c, "best_score");
  to.least_share = positive(c, "least_share");
  require(to.best_score > 1, "the best score is not above 1");
}

inline void take_probability(nb::handle c, ProbabilityNumbers& to) {
  take_support(c, to);
  to.worst_score = positive(c, "worst_score"), to.violation_offset = positive(c, "violation_offset");
  to.beside_offset = positive(c, "beside_offset"), to.same_plane_offset = positive(c, "same_plane_offset");
  to.max_margin = number(c, "max_margin"), to.unlikely_m_s = positive(c, "unlikely_m_s");
  to.unlikely_rad_s = positive(c, "unlikely_rad_s"), to.motion_score_weight = positive(c, "motion_score_weight");
  to.promising = number(c, "promising"), to.likely = number(c, "likely");
  to.convincing_inlier_ratio = number(c, "convincing_inlier_ratio");
}

inline Ranking ranking_of(nb::handle c) {
  Ranking r{};
  take_probability(c, r);
  r.same_pose_m = number(c, "same_pose_m"), r.same_pose_deg = number(c, "same_pose_deg");
  r.same_start_m = number(c, "same_start_m"), r.same_start_deg = number(c, "same_start_deg");
  r.rival_within = number(c, "rival_within"), r.max_refined = count(c, "max_refined");
  r.neighbour_m = number(c, "neighbour_m"), r.slid_m = number(c, "slid_m"), r.better_by = number(c, "better_by");
  r.maybe_better_by = number(c, "maybe_better_by"), r.screen_points = count(c, "screen_points");
  r.coarse_points = count(c, "coarse_points"), r.screen_iterations = iterations(c, "screen_iterations");
  r.smooth_iterations = iterations(c, "smooth_iterations"), r.coarse_angle = positive(c, "coarse_angle");
  r.align_angle = positive(c, "align_angle"), r.smooth_angle = positive(c, "smooth_angle");
  r.fine_angle = positive(c, "fine_angle"), r.twist_scale = six(c.attr("twist_scale"));
  for (const double scale : r.twist_scale) require(scale >= 1e-9 && scale <= 1e9, "a scale of the twist is out of range");
  return r;
}

// Of firstfix.answer.quality.AlignmentQuality.
inline Fit fit_of(nb::handle c) {
  Fit fit;
  fit.inlier_ratio = number(c, "inlier_ratio"), fit.alignment_score = number(c, "alignment_score");
  fit.free_space_violation = number(c, "free_space_violation"), fit.removed_surface = number(c, "removed_surface");
  fit.beside_surface = number(c, "beside_surface"), fit.same_plane = number(c, "same_plane");
  if (!c.attr("seen_free").is_none()) fit.seen_free = number(c, "seen_free");
  return fit;
}

inline RegistrationNumbers registration_of(nb::handle c) {
  return {positive(c, "map_voxel_m"),          positive(c, "coarse_voxel_m"),  iterations(c, "coarse_iterations"),
          iterations(c, "align_iterations"), positive(c, "fine_distance_m"), positive(c, "inlier_distance_m")};
}

inline NearbyNumbers nearby_of(nb::handle c) {
  const NearbyNumbers n{number(c, "reach_m"),   positive(c, "step_m"), count(c, "points"),    number(c, "worse_by"),
                        count(c, "refined"),    number(c, "apart_m"),  number(c, "apart_deg"), number(c, "better_by")};
  require(n.reach_m >= 0 && n.reach_m / n.step_m <= 200, "the local search has too many starts");
  return n;
}

inline AliasNumbers aliases_of(nb::handle c) {
  return {number(c, "near_m"), number(c, "behind"), count(c, "templates"), count(c, "screened"), count(c, "tried")};
}

inline Effort one_effort_of(nb::handle c) { return {count(c, "clusters"), count(c, "screened"), count(c, "candidates")}; }

inline EffortNumbers effort_of(nb::handle c) {
  const EffortNumbers made{count(c, "clusters"), count(c, "candidates"), count(c, "widened"), one_effort_of(c.attr("wide")),
                           one_effort_of(c.attr("exhaustive"))};
  require(made.candidates > 0, "a search has no candidates");
  return made;
}

inline Calibration calibration_of(nb::handle c) {
  Calibration made{};
  made.model = {number(c, "bias"),           number(c, "alignment_score"), number(c, "free_space"),
                number(c, "beside_surface"), number(c, "same_plane"),      number(c, "margin")};
  const nb::object among_tied = nb::getattr(c, "among_tied");
  if (nb::len(among_tied) > 0) made.among_tied = six(among_tied);
  made.min_probability = number(c, "min_probability"), made.search_until = number(c, "search_until");
  made.min_inlier_ratio = number(c, "min_inlier_ratio");
  made.max_free_space_violation = number(c, "max_free_space_violation");
  made.min_margin = number(c, "min_margin"), made.alias_margin = number(c, "alias_margin");
  made.is_prior = number(c, "cases") == 0;
  return made;
}

}  // namespace firstfix::python
