// From candidates of one map to the few poses at which a scan fits it (docs/method.md section 7).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/query/deadline.hpp"
#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/known_aliases.hpp"
#include "firstfix/query/local_search.hpp"
#include "firstfix/query/look_alikes.hpp"
#include "firstfix/query/minima_beside.hpp"
#include "firstfix/query/motion_at_places.hpp"
#include "firstfix/query/place_measures.hpp"
#include "firstfix/query/prior.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/scan_on_map.hpp"
#include "firstfix/query/searched_map.hpp"
#include "firstfix/query/searched_query.hpp"
#include "firstfix/query/stage_times.hpp"
#include "firstfix/query/template_places.hpp"
#include "firstfix/query/verdict.hpp"

namespace firstfix {

// Share of a search's best coarse alignment score, below which a candidate is hopeless. The right place had 0.905 or more in
// 729 searches (lab/docs/experiments.md, "Hopeless candidates").
constexpr double kHopefulFrom = 0.85;
// Alignment score from which on a place explains a scan so well that hopeless ones are no rivals. A scan that no place
// explains needs them: they tell that it is of another place.
constexpr double kExplainedFrom = 0.85;
// By which fine alignment may raise the inlier ratio.
constexpr double kRefinedBy = 0.15;

// Aligns the candidates of one query in one map and keeps the poses that compete for the answer. It keeps what it found: a
// later run adds to it, and repeats none of its work. Not thread-safe. The map, the query and the tables must outlive it. Its calls
// throw Error "query_cancelled" once the query is cancelled; it is of no use then.
class Search {
 public:
  Search(const SearchedMap& map, const SearchedQuery& query, const std::optional<PriorRegion>& prior, const Deadline& deadline = {})
      : map_(map),
        query_(query),
        prior_(prior),
        deadline_(deadline),
        fewest_points_(at_most(query.sparse, map.nearby.points, map.registration.map_voxel_m)),
        coarse_(map, query.sparse, map.ranking.coarse_points, deadline_),
        fewest_(map, fewest_points_, deadline_),
        few_(map, query.sparse, deadline_),
        many_(map, query.dense, deadline_),
        measures_(map, query, few_, many_),
        order_(map, measures_, query.spots),
        minima_(map, few_, many_),
        aliases_(map, query, deadline_, coarse_, few_) {
    if (query.is_in_time()) in_motion_.emplace(map, few_, kHopefulFrom);
  }
  Search(const Search&) = delete;
  Search& operator=(const Search&) = delete;

  // Distinct poses that the prior allows, best first: of all runs.
  const RegisteredPoses& found() const { return found_; }

  // Finds poses from these candidates and those of all earlier runs.
  //
  // twist: motion of the scan where these candidates come from. aliases: poses of the known aliases of the best pose.
  void run(const std::vector<Candidate>& candidates, const KnownTwist& twist, const std::vector<PoseMatrix>& aliases) {
    align(candidates, twist);
    rank(aliases);
  }

  // Aligns all new candidates with few points: coarsely, then the good ones on the map's own points.
  void align(const std::vector<Candidate>& candidates, const KnownTwist& twist) {
    const std::vector<Candidate> fresh = at(candidates, untried(candidates, twist));
    if (fresh.empty()) return;
    const std::vector<PoseMatrix> starts = poses_of(fresh);
    const std::vector<Registration> near = coarse_.align(starts, twist, map_.coarsely());
    tried_.insert(tried_.end(), starts.begin(), starts.end());
    double best = near.front().alignment_score;
    for (const Registration& one : near) best = std::max(best, one.alignment_score);
    few_.seen(twist, [&](Aligner& few) {
      for (const bool hopeful : {true, false}) {
        double explained = 0;
        bool is_any = false;
        for (std::size_t i = 0; i < fresh.size(); ++i) {
          if ((near[i].alignment_score >= kHopefulFrom * best) != hopeful) continue;
          const Registration rigid =
              few.align(near[i].T_level_sensor, map_.usually(), map_.registration.inlier_distance_m);
          explained = std::max(explained, rigid.alignment_score);
          is_any = true;
          aligned_.push_back({fresh[i].template_row, fresh[i].T_level_sensor, twist, rigid});
        }
        if (!is_any || explained >= kExplainedFrom) return;
      }
    });
  }

  // Ranks what was aligned. Only the best and its close rivals are aligned finely, and only if the best may still be accepted.
  void rank(const std::vector<PoseMatrix>& aliases) {
    found_ = registered();
    if (!(aliases.empty() && is_alone_and_good())) found_ = ranked(order_.checked(found_, aliases), map_.ranking);
    if (found_.empty() || !may_be_accepted()) {
      for (RegisteredPose& one : found_) measures_.measure(one);
      return;
    }
    refine();
    measure_finely();
  }

  // Largest share of the scan that lies on the map at one of the aligned poses.
  double most_inliers() const {
    double most = 0;
    for (const AlignedStart& one : aligned_) most = std::max(most, one.rigid.inlier_ratio);
    return most;
  }

  // Whether one of the aligned poses may explain the scan, if nothing passes through the map there. In motion, all may.
  bool may_explain_scan() {
    if (in_motion_ || map_.calibration.is_prior) return true;
    RegisteredPoses all = registered();
    return std::any_of(all.begin(), all.end(), [&](RegisteredPose& one) {
      if (one.fit.inlier_ratio < map_.ranking.convincing_inlier_ratio - kRefinedBy) return false;
      measures_.measure(one);
      return map_.calibration.most(one.fit, map_.ranking) >= kMayBeSure;
    });
  }

  // Moves the best pose to a better minimum beside it, if there is one: along the direction that the scan constrains least
  // where the pose would be the answer, else all around. Free space does not choose between the two: they are one place, seen
  // from nearly the same spot.
  void search_near() {
    if (found_.empty() || !may_be_accepted()) return;
    const Registration& placed = found_.front().registration;
    const auto offsets = is_settled() ? offsets_along(map_.nearby, placed.information) : offsets_around(map_.nearby);
    if (offsets.empty()) return;
    const auto [beside, is_first] = beside_.try_emplace(placed.T_level_sensor);
    if (is_first) {
      const auto better = best_near(map_, fewest_, many_, placed, offsets);
      if (better) beside->second = found_.front().moved(map_.ranking, *better);
      if (better) beside_in_order_.push_back(*beside->second);
    }
    if (!beside->second || allowed({*beside->second}).empty()) return;
    found_.front() = *beside->second;
    measures_.check_free_space(found_.front());
    measure_finely();
  }

  // Whether the best pose is so surely right that nothing else is searched for.
  bool is_settled() const {
    return !found_.empty() && found_.front().registration.rests &&
           map_.calibration.ends_search(features_of(found_, map_, query_.spots), map_.ranking);
  }

  // Whether the best pose would be accepted without its rivals, with up surely right. With a wrong up direction, up to two thirds
  // of a scan may lie on surfaces that nothing contradicts.
  bool explains_scan() const {
    return !found_.empty() && found_.front().fit.inlier_ratio >= map_.ranking.convincing_inlier_ratio &&
           map_.calibration.ends_search({found_.front().fit, map_.ranking.max_margin, 1}, map_.ranking);
  }

  // The probability from which on the best pose is accepted. asked: by the caller; not a number: none.
  double needed(double asked) const {
    return Judge::needed(map_.calibration, !found_.empty() && is_in_motion(found_.front().registration), asked);
  }

  // Whether the best pose would be the answer. needed: probability from which on a pose is accepted.
  bool is_accepted(double needed) const {
    return !found_.empty() && map_.calibration.accepts(features_of(found_, map_, query_.spots), map_.ranking, needed);
  }

  // Lets the known aliases of the best pose compete: those that were not registered yet, and could change the answer, are. nearby:
  // as search_near.
  void try_aliases(double needed, bool nearby, StageTimes& times) {
    if (found_.empty()) return;
    const Registration placed = found_.front().registration;
    std::vector<Candidate> rivals_found;
    std::vector<PoseMatrix> poses;
    times.of("aliases", [&] {
      const std::vector<Candidate> aliases = known_aliases(map_, placed.T_level_sensor, prior_);
      poses = poses_of(aliases);
      const std::vector<Candidate> fresh = at(aliases, untried(aliases, placed.twist));
      rivals_found = at(fresh, rivals(fresh, needed));
    });
    if (rivals_found.empty() && !leaves_out(poses)) return;
    times.of("register", [&] {
      run(rivals_found, placed.twist, poses);
      if (nearby) search_near();
    });
  }

  // The known aliases of the best pose that the prior excludes, if the scan may fit them as well.
  std::vector<Candidate> aliases_outside() {
    if (found_.empty() || !prior_) return {};
    const Registration& placed = found_.front().registration;
    std::vector<Candidate> outside;
    for (const Candidate& one : known_aliases(map_, placed.T_level_sensor, std::nullopt)) {
      if (!prior_->allows(one.T_level_sensor)) outside.push_back(one);
    }
    return at(outside, not_far_behind(poses_of(outside), placed.T_level_sensor, placed.twist));
  }

  // Support by which the best of some poses that the prior excludes is better than the best one in it, or 0.
  double lead_outside(const RegisteredPoses& found_anywhere) const {
    double lead = 0;
    if (found_.empty() || !prior_) return lead;
    for (const RegisteredPose& one : found_anywhere) {
      if (!prior_->allows(one.registration.T_level_sensor)) {
        lead = std::max(lead, one.support - found_.front().support);
      }
    }
    return lead;
  }

  // Marks the poses that the scan does not tell from the best one.
  void mark_look_alikes() {
    if (found_.empty()) return;
    const std::vector<Candidate> aliases = known_aliases(map_, found_.front().registration.T_level_sensor, prior_);
    firstfix::mark_look_alikes(found_, map_, poses_of(aliases));
  }

  // Whether the last run left out a place that would tie with the best pose, as a known alias.
  bool leaves_out(const std::vector<PoseMatrix>& aliases) const {
    return !found_.empty() && !order_.tied_aliases(found_.front(), aliases).empty();
  }

  // Of known aliases of the best pose, the rows of those that could change the answer. needed: probability from which on a
  // pose is accepted.
  std::vector<std::int64_t> rivals(const std::vector<Candidate>& aliases, double needed) {
    if (found_.empty()) return {};
    return aliases_.rivals(aliases, found_.front(), needed);
  }

  // Of aliases of a pose, the rows of the few at which a probe finds the scan to fit nearly as well, best first.
  std::vector<std::int64_t> not_far_behind(const std::vector<PoseMatrix>& aliases, const PoseMatrix& T_level_sensor,
                                           const KnownTwist& twist) {
    return aliases_.not_far_behind(aliases, T_level_sensor, twist);
  }

  // Rows of the candidates that start near no start, and no aligned pose, of an earlier run. With a motion, starts are where
  // the sensor would be, and not where the skewed scan would lie.
  std::vector<std::int64_t> untried(const std::vector<Candidate>& candidates, const KnownTwist& twist) const {
    std::vector<PoseMatrix> known;
    if (!twist || !in_motion_) {
      known = tried_;
      for (const AlignedStart& one : aligned_) known.push_back(one.rigid.T_level_sensor);
    } else {
      known = in_motion_->poses();
    }
    const double within_m = map_.ranking.same_start_m, cosine = std::cos(radians(map_.ranking.same_start_deg));
    std::vector<std::int64_t> fresh;
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      const bool is_known = is_any_of(candidates[i].T_level_sensor, known, within_m, cosine);
      if (!is_known) fresh.push_back(static_cast<std::int64_t>(i));
    }
    return fresh;
  }

 private:
  static std::vector<Candidate> at(const std::vector<Candidate>& candidates, const std::vector<std::int64_t>& rows) {
    std::vector<Candidate> some;
    for (const std::int64_t row : rows) some.push_back(candidates[static_cast<std::size_t>(row)]);
    return some;
  }

  // The best ones that may compete, of all runs: distinct poses that the prior allows, best first.
  RegisteredPoses registered() {
    std::vector<PoseMatrix> all;
    for (const AlignedStart& one : aligned_) all.push_back(one.rigid.T_level_sensor);
    std::vector<std::size_t> rows = allowed_rows(all);
    std::stable_sort(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) {
      return aligned_[a].rigid.alignment_score > aligned_[b].rigid.alignment_score;
    });
    std::vector<PoseMatrix> T;
    for (const std::size_t row : rows) T.push_back(aligned_[row].rigid.T_level_sensor);
    std::vector<std::size_t> compared;
    for (const auto k : distinct_poses(T, map_.ranking.same_pose_m, radians(map_.ranking.same_pose_deg), map_.compared)) {
      compared.push_back(rows[static_cast<std::size_t>(k)]);
    }
    // wrong places gain by the motion as well as the right one, so all that are compared get it
    std::vector<Registration> solved;
    if (in_motion_ && !compared.empty()) solved = in_motion_->solve(aligned_, compared);
    RegisteredPoses made;
    for (std::size_t k = 0; k < compared.size(); ++k) {
      const AlignedStart& one = aligned_[compared[k]];
      made.emplace_back(map_.ranking, one.template_row, one.T_start[11], in_motion_ ? solved[k] : one.rigid);
    }
    if (aligned_.empty()) return made;
    for (const RegisteredPose& one : allowed(beside_in_order_)) made.push_back(one);
    // the motion may have changed the order, an unlikely one counts against a place, and so does meeting little of the map
    std::stable_sort(made.begin(), made.end(), has_more_support);
    return made;
  }

  // Whether there is one pose, which is worth its refinement before its free space is checked: it is checked where it ends alone.
  bool is_alone_and_good() {
    if (found_.size() != 1) return false;
    measures_.measure(found_.front());
    return may_be_accepted();
  }

  // Whether fine alignment is worth its time. Always so while the calibration is the prior.
  bool may_be_accepted() const {
    return map_.calibration.is_prior ||
           map_.calibration.probability(features_of(found_, map_, query_.spots), map_.ranking) >= map_.ranking.promising;
  }

  // Aligns the best and its close rivals again with many points. A rival that is a little worse may only have been aligned
  // worse: it gets the same chance.
  void refine() {
    const double close = found_.front().support - map_.ranking.rival_within;
    for (std::size_t i = 0; i < std::min(found_.size(), map_.ranking.max_refined) && found_[i].support > close; ++i) {
      RegisteredPose& one = found_[i];
      one = one.moved(map_.ranking, minima_.refined(one));
      measures_.check_free_space(one);
    }
  }

  // The poses that the prior allows, best first. The agreement of the best one, and of those that may tie with it, is measured
  // with many points: which of them leads, rounding decides.
  void measure_finely() {
    found_ = ranked(allowed(found_), map_.ranking);
    for (std::size_t i = 0; i < found_.size(); ++i) {
      const double lead = found_.front().support - found_[i].support;
      if (i == 0 || (i < kMeasuredFinely && lead < map_.calibration.min_margin + kBlur)) {
        measures_.measure_finely(found_[i]);
      } else {
        measures_.measure(found_[i]);
      }
    }
  }

  std::vector<std::size_t> allowed_rows(const std::vector<PoseMatrix>& T_level_sensor) const {
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < T_level_sensor.size(); ++i) {
      if (!prior_ || prior_->allows(T_level_sensor[i])) rows.push_back(i);
    }
    return rows;
  }

  RegisteredPoses allowed(const RegisteredPoses& poses) const {
    if (!prior_) return poses;
    std::vector<PoseMatrix> T;
    for (const RegisteredPose& one : poses) T.push_back(one.registration.T_level_sensor);
    RegisteredPoses kept;
    for (const std::size_t row : allowed_rows(T)) kept.push_back(poses[row]);
    return kept;
  }

  const SearchedMap& map_;
  const SearchedQuery& query_;
  std::optional<PriorRegion> prior_;
  Deadline deadline_;
  ScannedSurface fewest_points_;  // a part of the sparse ones
  ScanOnCells coarse_;
  ScanOnMap fewest_, few_, many_;
  PlaceMeasures measures_;
  FreeSpaceOrder order_;
  MinimaBeside minima_;
  KnownAliases aliases_;
  std::optional<MotionAtPlaces> in_motion_;
  std::vector<PoseMatrix> tried_;  // all starts
  std::vector<AlignedStart> aligned_;
  std::map<PoseMatrix, std::optional<RegisteredPose>> beside_;  // by pose: the better one beside it
  RegisteredPoses beside_in_order_;                             // as they were found
  RegisteredPoses found_;
};

}  // namespace firstfix
