#include "diagnosis.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "finding_texts.hpp"
#include "input_findings.hpp"
#include "other_forms.hpp"
#include "place_findings.hpp"
#include "poses.hpp"
#include "viewpoint.hpp"

namespace firstfix::version {
namespace {

using Clock = Deadline::Clock;

double seconds_since(Clock::time_point then) { return std::chrono::duration<double>(Clock::now() - then).count(); }

// The last scan, whole and alone in its query; null: it is not.
const Scan* only_scan(const AskedQuery& query) {
  return query.prepared != nullptr && query.scans.size() == 1 ? query.scans.front().whole : nullptr;
}

const PreparedQuery::KeptScan& prepared_scan_of(const AskedQuery& query) { return query.prepared->prepared().scans().back(); }

PoseMatrix in_map(const AskedQuery& query, const RegisteredPose& pose) {
  return product(query.map.templates.numbers.T_map_level, pose.registration.T_level_sensor);
}

const AlignmentQuality* best_fit(const Localization& answer) {
  return answer.hypotheses.empty() ? nullptr : &*answer.hypotheses.front().quality;
}

// The finding by the points of a scan that was not localized.
std::optional<Finding> by_points(const Localization& answer, const AskedQuery& query, const ScanFacts& facts, const LookedAt& scan) {
  constexpr double kFlat = 0.01;  // plane ratio of a 2-D LiDAR's scan
  if (auto cause = input_finding(facts, scan)) return cause;
  const auto in_range = static_cast<double>(facts.in_range);
  if (facts.rings == 1 || (facts.plane_ratio && *facts.plane_ratio < kFlat)) return found("one_plane", {{"in_range", in_range}});
  if (answer.reasons.front() != "too_few_points") return std::nullopt;
  const Preparation& limits = query.map.templates.numbers.preparation;
  return found("few_points", {{"points", static_cast<double>(facts.points)},
                              {"in_range", in_range},
                              {"min_range_m", limits.min_range_m},
                              {"max_range_m", limits.max_range_m},
                              {"needed", static_cast<double>(limits.min_points)},
                              {"voxel_m", limits.voxel_m}});
}

// Whether a scan fits several places so well that no other form of it need be tried.
bool fits_as_sent(const Localization& answer) {
  constexpr double kFitsFrom = 0.85;  // inlier ratio of places that tie; poorer ones tie because nothing fits
  const AlignmentQuality* const fit = best_fit(answer);
  return answer.verdict == Verdict::ambiguous && fit != nullptr && fit->inlier_ratio >= kFitsFrom;
}

// The finding of the first form in which the scan would be localized, if there is one.
std::optional<Finding> by_other_forms(const Localization& answer, const AskedQuery& query) {
  constexpr double kBetter = 0.1;  // share of the scan that lies on the map, above that of the scan as it was sent
  constexpr double kSlower = 1.5;  // than the forms before it, at worst
  const Scan* const scan = only_scan(query);
  if (scan == nullptr) return std::nullopt;
  const Scan usable = cleaned(*scan);
  const AlignmentQuality* const fit = best_fit(answer);
  const double sent_ratio = fit == nullptr ? 0 : fit->inlier_ratio;
  const auto start = Clock::now();
  const double most_s = std::min(query.explaining * seconds_since(query.began), query.deadline.left_s());
  double longest_s = 0;
  for (const OtherForm& form : other_forms(usable, query.options, prepared_scan_of(query).height_m, query.map.usual_height_m)) {
    const auto began = Clock::now();
    if (!(std::chrono::duration<double>(began - start).count() + kSlower * longest_s <= most_s)) return std::nullopt;
    const Scan changed = form.scan();
    auto prepared = version::prepared(sent(changed), form.options, query.map);
    if (!prepared) {
      longest_s = std::max(longest_s, seconds_since(began));
      continue;
    }
    MapQuery asked_again(query.map, std::move(*prepared), form.options, query.deadline);
    MapSearch& search = asked_again.search();
    StageTimes times;
    if (search.may_fit(sent_ratio + kBetter / 2, times)) {
      search.take(Step::narrow, times);
      search.rank(times);
    }
    longest_s = std::max(longest_s, seconds_since(began));
    if (!search.is_settled()) continue;
    const RegisteredPose& best = search.found().front();
    if (best.fit.inlier_ratio > sent_ratio + kBetter) {
      return form.finding(in_map(query, best), {{"inlier_ratio", best.fit.inlier_ratio}, {"inlier_ratio_as_sent", sent_ratio}});
    }
  }
  return std::nullopt;
}

// The finding that the scan was not taken from its own origin. A localized scan is probed; the search is for suspects, for a pose at
// the map's own origin, and for what was not localized. T_map_sensor: of the answer, or null.
std::optional<Finding> wrong_frame(const PoseMatrix* T_map_sensor, const AskedQuery& query, const ScanFacts& facts, const LookedAt& scan) {
  if (only_scan(query) == nullptr) return std::nullopt;
  const std::vector<float>& seen = prepared_scan_of(query).seen;
  const Vectors<const float> points{seen.data(), seen.size() / 3};
  const bool is_at_origin = T_map_sensor != nullptr && is_map_origin(*T_map_sensor);
  if (T_map_sensor != nullptr && !is_at_origin && !is_suspect({scan.part.data(), scan.part.size() / 3})) return std::nullopt;
  if ((is_at_origin || T_map_sensor == nullptr) && is_even(points)) {
    return found("no_viewpoint", {{"in_range", static_cast<double>(facts.in_range)}});
  }
  const Viewpoint best = best_viewpoint(points);
  if (!is_elsewhere(best, T_map_sensor)) return std::nullopt;
  const auto [x_m, y_m, z_m] = best.position_m;
  return found("other_viewpoint", {{"x_m", x_m}, {"y_m", y_m}, {"z_m", z_m}, {"spread_ratio", best.spread_ratio}});
}

// The finding that a field looks like times and was not understood.
std::optional<Finding> time_field_finding(const AskedQuery& query) {
  const Scan* const scan = query.scans.back().whole;
  if (scan == nullptr || scan->time_s || !scan->time_field || scan->time_field->is_filling()) return std::nullopt;
  const TimeField& field = *scan->time_field;
  return found("time_field_unknown", {{"first", field.first}, {"last", field.last}}, {{"field", field.described()}, {"why", field.why}});
}

// The finding that an answer may be unsure because the robot moved, and the scan has no times.
std::optional<Finding> no_times_finding(const Localization& answer, const ScanFacts& facts) {
  const bool is_bent = answer.reasons.front() == "low_probability" || answer.reasons.front() == "low_inlier_ratio";
  if (!is_bent || facts.time_span_s) return std::nullopt;
  return found("no_times", {});
}

}  // namespace

void diagnose(Localization& answer, const AskedQuery& query) {
  const LookedAt scan(query.scans.back());
  const ScanFacts facts = facts_of(scan, query.map.templates.numbers.preparation);
  std::vector<std::optional<Finding>> findings;
  if (answer.verdict == Verdict::localized) {
    const PoseMatrix T_map_sensor = in_map(query, query.prepared->search().found().front());
    auto elsewhere = wrong_frame(&T_map_sensor, query, facts, scan);
    if (elsewhere) {
      Localization refused;
      refused.reasons = {"wrong_frame"};
      answer = refused;
    } else {
      elsewhere = mounting_finding(T_map_sensor, query.options);
    }
    findings = {elsewhere, time_field_finding(query)};
  } else {
    auto cause = by_points(answer, query, facts, scan);
    if (!cause && query.explaining > 0 && !fits_as_sent(answer)) cause = by_other_forms(answer, query);
    if (!cause) cause = wrong_frame(nullptr, query, facts, scan);
    auto times = time_field_finding(query);
    if (!times && !cause) times = no_times_finding(answer, facts);
    findings = {cause, reason_finding(answer), times};
  }
  for (const std::optional<Finding>& one : findings) {
    if (one) answer.findings.push_back(*one);
  }
  answer.scan = facts;
}

}  // namespace firstfix::version
