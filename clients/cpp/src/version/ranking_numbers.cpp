#include "ranking_numbers.hpp"

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <vector>

namespace firstfix::version {
namespace {

constexpr double kMost = 1e9, kLeast = 1e-9;  // of a number, and of one that is above 0
constexpr double kWidestTaughtM = 10.0;       // as firstfix.engine.with_prior

// All fields of firstfix.engine.ranking.RankingConfig.
constexpr const char* kRanking[] = {
    "align_angle",      "alignment_weight",     "beside_offset",      "best_score",       "better_by",
    "coarse_angle",     "coarse_points",        "convincing_inlier_ratio", "dense_points", "fine_angle",
    "least_share",      "likely",               "max_margin",         "max_refined",      "maybe_better_by",
    "motion_score_weight", "neighbour_m",       "promising",          "removed_weight",   "rival_within",
    "same_place_deg",   "same_place_m",         "same_plane_offset",  "same_pose_deg",    "same_pose_m",
    "same_start_deg",   "same_start_m",         "screen_iterations",  "screen_points",    "seen_free_offset",
    "seen_free_weight", "slid_m",               "smooth_angle",       "smooth_iterations", "sparse_points",
    "spots_apart_m",    "twist_scale",          "unlikely_m_s",       "unlikely_rad_s",   "unregistered_bias",
    "unregistered_lead", "unregistered_score",  "view_points",        "violation_offset", "violation_weight",
    "voxelled_points",  "worst_score"};

// Fields of firstfix.engine.calibration.Calibration that each has. One may also have `with_prior`.
constexpr const char* kCalibration[] = {"alias_margin", "alignment_score",  "among_tied",      "beside_surface",
                                        "bias",         "cases",            "free_space",      "margin",
                                        "max_free_space_violation", "min_inlier_ratio", "min_margin", "min_probability",
                                        "same_plane",   "search_until"};

// Refuses an object with other fields. optional: how many more it may have that are not named.
template <std::size_t N>
void require_fields(const Json& stored, const char* const (&names)[N], std::size_t optional, const char* what) {
  if (!stored.is_object()) refuse(std::string(what) + " is not an object");
  const bool has_all = std::all_of(names, names + N, [&](const char* name) { return stored.contains(name); });
  if (!has_all || stored.size() != N + optional) {
    throw Error("incompatible_version", std::string(what) + " has other numbers than this library ranks by: build the map again, or update this library");
  }
}

Vector6 six_in(const Json& object, const char* name) {
  Vector6 made;
  const std::vector<double> values = numbers_in(object, name, 6, 6, kMost);
  std::copy(values.begin(), values.end(), made.begin());
  return made;
}

Calibration calibration(const Json& stored, bool may_have_prior) {
  const bool has_prior = may_have_prior && stored.is_object() && stored.contains("with_prior");
  require_fields(stored, kCalibration, has_prior ? 1 : 0, "calibration.json");
  const auto number = [&](const char* name) { return number_in(stored, name, -kMost, kMost); };
  Calibration made{};
  made.model = {number("bias"),           number("alignment_score"), number("free_space"),
                number("beside_surface"), number("same_plane"),      number("margin")};
  const Json& among_tied = field(stored, "among_tied");
  if (!among_tied.is_array() || !among_tied.empty()) made.among_tied = six_in(stored, "among_tied");
  made.min_probability = number("min_probability"), made.search_until = number("search_until");
  made.min_inlier_ratio = number("min_inlier_ratio"), made.max_free_space_violation = number("max_free_space_violation");
  made.min_margin = number("min_margin"), made.alias_margin = number("alias_margin");
  made.is_prior = whole_in(stored, "cases", 0, kMost) == 0;
  return made;
}

}  // namespace

Ranking ranking_numbers(const Json& stored) {
  require_fields(stored, kRanking, 0, "the ranking");
  const auto number = [&](const char* name) { return number_in(stored, name, -kMost, kMost); };
  const auto positive = [&](const char* name) { return number_in(stored, name, kLeast, kMost); };
  const auto count = [&](const char* name) { return whole_in(stored, name, 0, 1e6); };
  const auto iterations = [&](const char* name) { return static_cast<int>(whole_in(stored, name, 0, 1000)); };
  Ranking r{};
  r.alignment_weight = number("alignment_weight"), r.removed_weight = number("removed_weight");
  r.violation_weight = number("violation_weight"), r.seen_free_weight = number("seen_free_weight");
  r.seen_free_offset = positive("seen_free_offset"), r.best_score = number_in(stored, "best_score", 1 + kLeast, kMost);
  r.least_share = positive("least_share"), r.worst_score = positive("worst_score");
  r.violation_offset = positive("violation_offset"), r.beside_offset = positive("beside_offset");
  r.same_plane_offset = positive("same_plane_offset"), r.max_margin = number("max_margin");
  r.unlikely_m_s = positive("unlikely_m_s"), r.unlikely_rad_s = positive("unlikely_rad_s");
  r.motion_score_weight = positive("motion_score_weight"), r.promising = number("promising");
  r.likely = number("likely"), r.convincing_inlier_ratio = number("convincing_inlier_ratio");
  r.same_pose_m = number("same_pose_m"), r.same_pose_deg = number("same_pose_deg");
  r.same_start_m = number("same_start_m"), r.same_start_deg = number("same_start_deg");
  r.rival_within = number("rival_within"), r.max_refined = count("max_refined");
  r.neighbour_m = number("neighbour_m"), r.slid_m = number("slid_m"), r.better_by = number("better_by");
  r.maybe_better_by = number("maybe_better_by"), r.screen_points = count("screen_points");
  r.coarse_points = count("coarse_points"), r.screen_iterations = iterations("screen_iterations");
  r.smooth_iterations = iterations("smooth_iterations"), r.coarse_angle = positive("coarse_angle");
  r.align_angle = positive("align_angle"), r.smooth_angle = positive("smooth_angle");
  r.fine_angle = positive("fine_angle"), r.twist_scale = six_in(stored, "twist_scale");
  if (!std::all_of(r.twist_scale.begin(), r.twist_scale.end(), [](double scale) { return scale >= kLeast; })) {
    refuse("twist_scale is out of range");
  }
  return r;
}

const Calibration& Calibrations::judging(const std::optional<double>& radius_m) const {
  return with_prior && radius_m && *radius_m <= kWidestTaughtM ? *with_prior : usual;
}

Calibrations calibrations(const MappedFile& file) {
  const Json stored = parsed(reinterpret_cast<const char*>(file.data()), file.size(), file.name());
  Calibrations made{calibration(stored, true), std::nullopt};
  const auto taught = stored.find("with_prior");
  if (taught != stored.end()) made.with_prior = calibration(*taught, false);
  return made;
}

}  // namespace firstfix::version
