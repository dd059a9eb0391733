#include "scan_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "asked_scan.hpp"
#include "firstfix/query/joined_scans.hpp"
#include "firstfix/query/level_hypotheses.hpp"
#include "firstfix/scan/other_ups.hpp"
#include "poses.hpp"

namespace firstfix::version {
namespace {

// As firstfix.engine.map_search.
constexpr double kScreenedPerRegistered = 12;   // poses that are screened in the time of one candidate's registration
constexpr double kComparedPerRegistered = 200;  // templates that are compared in this time
constexpr double kSlower = 1.5;                 // than estimated, at worst
constexpr double kOtherUps = 6;                 // at most, each with a first search of its own
constexpr std::size_t kLeastPerScan = 3;        // as firstfix.engine.candidates

SearchedQuery query_of(const std::vector<PlacedScan>& scans, const EngineNumbers& numbers) {
  SearchedQuery made;
  std::vector<PoseMatrix> poses;
  for (const PlacedScan& one : scans) {
    const bool is_timed = one.prepared.viewed.times() != nullptr;
    made.scans.push_back({one.T_last_scan, one.prepared.view, is_timed ? one.prepared.viewed : PointsInTime{}});
    poses.push_back(one.T_last_scan);
  }
  made.spots = spots_of(poses, numbers.spots_apart_m);
  const PreparedScan& first = scans.front().prepared;
  if (scans.size() == 1 && poses.front() == kSameFrame) {
    made.dense = first.dense, made.sparse = first.sparse.size() > 0 ? first.sparse : first.dense;
    return made;
  }
  std::vector<PlacedSurface> parts;
  for (const PlacedScan& one : scans) parts.push_back({one.T_last_scan, &one.prepared.dense});
  const Preparation& wanted = numbers.preparation;
  JoinedSurface together = joined(parts, wanted.voxel_m, wanted.dense_points, wanted.sparse_points);
  made.dense = std::move(together.dense), made.sparse = std::move(together.sparse);
  return made;
}

std::optional<PriorRegion> region_of(const std::optional<Prior>& prior, const PoseMatrix& T_map_level) {
  if (!prior) return std::nullopt;
  return PriorRegion{T_map_level, prior->position, prior->radius_m, prior->yaw_deg, prior->yaw_range_deg};
}

SurfacePoints points_of(const ScannedSurface& surface) {
  return {surface.at.points.data(), surface.normals.data(), surface.size()};
}

}  // namespace

ScanSearch::ScanSearch(const TemplateTables& templates, const SearchedMap& map, double usual_height_m,
                       std::vector<PlacedScan>&& scans, const PlacesOptions& options, const std::optional<Clock::time_point>& deadline)
    : templates_(templates),
      map_(map),
      usual_height_m_(usual_height_m),
      options_(options),
      deadline_(deadline),
      scans_(std::move(scans)),
      query_(query_of(scans_, templates.numbers)),
      search_(map, query_, region_of(options.prior, templates.numbers.T_map_level)) {}

void ScanSearch::climb() {
  take(Step::narrow);
  if (!search_.is_settled()) take(Step::wide);
  for (const Step step : {Step::other_ups, Step::exhaustive}) {
    if (search_.explains_scan()) return;
    take(step);
  }
}

void ScanSearch::try_aliases(double asked) {
  const EngineNumbers& numbers = templates_.numbers;
  if (!map_.alias_table || !search_.is_accepted(search_.needed(asked))) return;
  const double share = static_cast<double>(numbers.aliases.tried) / static_cast<double>(numbers.candidates);
  const bool in_time = kSlower * narrow_s_ * share <= left_s();
  if (in_time) search_.try_aliases(search_.needed(asked), numbers.is_widened, times_);
  search_.mark_look_alikes();
  if (in_time && options_.prior) compare_outside();
}

void ScanSearch::take(Step step) {
  const EngineNumbers& numbers = templates_.numbers;
  if (expected_s(step) > left_s()) return;
  if (step == Step::narrow) {
    const auto began = Clock::now();
    by_descriptor(as_measured());
    narrow_s_ = std::chrono::duration<double>(Clock::now() - began).count();
  } else if (step == Step::other_ups) {
    by_descriptor(with_other_ups());
  } else if (numbers.is_widened && !options_.max_places) {
    const bool is_last = step == Step::exhaustive;
    by_screening(is_last ? numbers.exhaustive : numbers.wide, is_last);
  }
}

void ScanSearch::by_descriptor(const std::vector<Levelled>& levelled) {
  if (!levelled.empty()) run(similar(levelled, options_.prior));
}

// Distinct candidates whose poses fit the coarse map best, best first. The descriptor alone mistakes the place where sparse
// beams, occluders or a wrong up change many cells. A hundred points of the scan tell the places apart at a tenth of a
// registration's time.
void ScanSearch::by_screening(const Effort& effort, bool tilted) {
  std::optional<detail::Vector3> expected;
  if (!options_.gravity) expected = up_by_mounting(options_.T_base_sensor);
  const SurfacePoints points = points_of(query_.dense);
  std::vector<ScanToLevel> to_level;
  for (const PlacedScan& one : scans_) to_level.push_back({one.T_last_scan, one.prepared.R_level_sensor, points_of(one.prepared.dense)});
  std::vector<Levelled> levelled;
  for (const LevelHypothesis& one : level_hypotheses(to_level, points, expected, usual_height_m_, tilted)) {
    levelled.push_back({&scans_[one.scan], one.R_level_sensor, one.height_m});
  }
  const auto share = [&](std::size_t all) { return std::max<std::size_t>(1, all / levelled.size()); };
  std::vector<Candidate> found = merged(levelled, options_.prior, {share(effort.screened), share(effort.clusters), false});
  // neighbours read the same part of the map
  std::stable_sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) { return a.template_row < b.template_row; });
  ScanOnCells few(map_, query_.sparse, map_.ranking.screen_points);
  const std::vector<Registration> screened = few.align(poses_of(found), std::nullopt, map_.barely());
  for (std::size_t i = 0; i < found.size(); ++i) {
    found[i].T_level_sensor = screened[i].T_level_sensor, found[i].score = screened[i].alignment_score;
  }
  sort_by_score(found);
  std::vector<Candidate> distinct;
  for (const auto row : distinct_poses(poses_of(found), map_.ranking.same_pose_m, radians(map_.ranking.same_pose_deg), effort.candidates)) {
    distinct.push_back(found[static_cast<std::size_t>(row)]);
  }
  run(distinct);
}

std::vector<ScanSearch::Levelled> ScanSearch::as_measured() const {
  std::vector<Levelled> levelled;
  for (const PlacedScan& one : scans_) levelled.push_back({&one, one.prepared.R_level_sensor, one.prepared.height_m, true});
  return levelled;
}

// Every scan, levelled by each of the other directions that may be up in the last one.
std::vector<ScanSearch::Levelled> ScanSearch::with_other_ups() const {
  const SurfacePoints points = points_of(query_.dense);
  const PlacedScan& last = scans_.back();
  const detail::Vector3 known = detail::in_last(last.T_last_scan, last.prepared.R_level_sensor[2]);
  std::vector<Levelled> levelled;
  for (const detail::Vector3& up : other_ups(points.normals, points.count, known, options_.gravity)) {
    for (const PlacedScan& one : scans_) {
      const detail::Vector3 own_up = detail::in_scan(one.T_last_scan, up);
      const SurfacePoints own = points_of(one.prepared.dense);
      const auto seen_m = height_above_floor(own.points, own.normals, own.count, own_up);
      levelled.push_back({&one, detail::levelling_rotation(own_up), seen_m.value_or(templates_.numbers.default_height_m)});
    }
  }
  return levelled;
}

std::vector<Candidate> ScanSearch::similar(const std::vector<Levelled>& levelled, const std::optional<Prior>& prior) const {
  const EngineNumbers& numbers = templates_.numbers;
  const std::size_t count = options_.max_places.value_or(numbers.candidates);
  const std::size_t each = levelled.size() > 1 ? std::max(kLeastPerScan, 2 * count / levelled.size()) : count;
  return merged(levelled, prior, {each, numbers.clusters});
}

// Of all levellings, most similar first.
std::vector<Candidate> ScanSearch::merged(const std::vector<Levelled>& levelled, const std::optional<Prior>& prior,
                                          const Wanted& wanted) const {
  std::vector<Candidate> all;
  for (const Levelled& one : levelled) {
    const PoseMatrix& T = one.scan->T_last_scan;
    std::optional<Prior> near = prior;  // it is about the last scan
    if (near) near->radius_m += std::sqrt(T[3] * T[3] + T[7] * T[7] + T[11] * T[11]);
    const LevelledFrame frame{one.R_level_sensor, one.height_m, inverse(T)};
    const ScanDescriptor* described = one.is_as_measured ? one.scan->described : nullptr;
    const std::vector<Candidate> some = templates_.candidates(one.scan->prepared.seen, described, frame, near, wanted);
    all.insert(all.end(), some.begin(), some.end());
  }
  if (levelled.size() > 1) sort_by_score(all);
  return all;
}

void ScanSearch::run(const std::vector<Candidate>& candidates) {
  search_.run(candidates, std::nullopt, {});
  if (templates_.numbers.is_widened) search_.search_near();
}

// Compares the best pose with places outside the prior, if an alias there fits nearly as well. Those that are as good do not
// count: which of them is right, the prior says. One that is clearly better shows that the prior is wrong.
void ScanSearch::compare_outside() {
  std::vector<Candidate> places = search_.aliases_outside();
  if (places.empty()) return;
  const std::vector<Candidate> anywhere = similar(as_measured(), std::nullopt);
  places.insert(places.end(), anywhere.begin(), anywhere.end());
  sort_by_score(places);
  Search outside(map_, query_, std::nullopt);
  outside.run(places, search_.found().front().registration.twist, {});
  outside_lead_ = search_.lead_outside(outside.found());
}

// Seconds that a step takes, at worst: measured by the first one, which always runs.
double ScanSearch::expected_s(Step step) const {
  const EngineNumbers& numbers = templates_.numbers;
  if (step == Step::narrow) return -std::numeric_limits<double>::infinity();
  if (step == Step::other_ups) return kSlower * kOtherUps * narrow_s_;
  const Effort& effort = step == Step::exhaustive ? numbers.exhaustive : numbers.wide;
  const double registrations = static_cast<double>(effort.candidates) + static_cast<double>(effort.screened) / kScreenedPerRegistered +
                               static_cast<double>(effort.clusters) / kComparedPerRegistered;
  return kSlower * narrow_s_ * registrations / static_cast<double>(numbers.candidates);
}

double ScanSearch::left_s() const {
  if (!deadline_) return std::numeric_limits<double>::infinity();
  return std::chrono::duration<double>(*deadline_ - Clock::now()).count();
}

}  // namespace firstfix::version
