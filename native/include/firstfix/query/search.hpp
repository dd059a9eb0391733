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

#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/local_search.hpp"
#include "firstfix/query/minima_beside.hpp"
#include "firstfix/query/motion_at_places.hpp"
#include "firstfix/query/place_measures.hpp"
#include "firstfix/query/prior.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/scan_on_map.hpp"
#include "firstfix/query/searched_map.hpp"
#include "firstfix/query/searched_query.hpp"

namespace firstfix {

// Share of a search's best coarse alignment score, below which a candidate is hopeless. The right place had 0.905 or more in
// 729 searches (lab/docs/experiments.md, "Hopeless candidates").
constexpr double kHopefulFrom = 0.85;
// Alignment score from which on a place explains a scan so well that hopeless ones are no rivals. A scan that no place
// explains needs them: they tell that it is of another place.
constexpr double kExplainedFrom = 0.85;

// A pose that a template implies, where an alignment begins.
struct Candidate {
  std::int64_t template_row;
  PoseMatrix T_level_sensor;
};

// Aligns the candidates of one query in one map and keeps the poses that compete for the answer. It keeps what it found: a
// later run adds to it, and repeats none of its work. Not thread-safe. The map, the query and the tables must outlive it.
class Search {
 public:
  Search(const SearchedMap& map, const SearchedQuery& query, std::optional<Prior> prior)
      : map_(map),
        query_(query),
        prior_(prior),
        coarsest_(at_most(query.sparse, map.ranking.coarse_points, map.registration.coarse_voxel_m)),
        fewest_(at_most(query.sparse, map.nearby.points, map.registration.map_voxel_m)),
        coarse_(map.coarse, coarsest_),
        fewest_on_map_(map, fewest_),
        few_(map, query.sparse),
        many_(map, query.dense),
        measures_(map, query, few_, many_),
        order_(map, measures_, query.spots),
        minima_(map, few_, many_) {
    if (query.is_in_time()) in_motion_.emplace(map, few_, kHopefulFrom);
  }
  Search(const Search&) = delete;
  Search& operator=(const Search&) = delete;

  // Distinct poses that the prior allows, best first: of all runs.
  const RegisteredPoses& found() const { return found_; }

  // Finds poses from these candidates and those of all earlier runs. Only the best and its close rivals are aligned finely,
  // and only if the best may still be accepted.
  //
  // twist: motion of the scan where these candidates come from. aliases: poses of the known aliases of the best pose.
  void run(const std::vector<Candidate>& candidates, const KnownTwist& twist, const std::vector<PoseMatrix>& aliases) {
    align(candidates, twist);
    found_ = ranked(order_.checked(registered(), aliases), map_.ranking);
    if (found_.empty() || !may_be_accepted()) {
      for (RegisteredPose& one : found_) measures_.measure(one);
      return;
    }
    refine();
    measure_finely();
  }

  // Moves the best pose to a better minimum beside it, if there is one: along the direction that the scan constrains least
  // where the pose would be the answer, else all around. Free space does not choose between the two: they are one place, seen
  // from nearly the same spot.
  void search_near() {
    if (found_.empty()) return;
    const Registration& placed = found_.front().registration;
    const auto offsets = is_settled() ? offsets_along(map_.nearby, placed.information) : offsets_around(map_.nearby);
    if (offsets.empty()) return;
    const auto [beside, is_first] = beside_.try_emplace(placed.T_level_sensor);
    if (is_first) {
      const auto better = best_near(map_, fewest_on_map_, many_, placed, offsets);
      if (better) beside->second = found_.front().moved(map_.ranking, *better);
      if (better) beside_in_order_.push_back(*beside->second);
    }
    if (!beside->second || !allows(*beside->second)) return;
    found_.front() = *beside->second;
    measures_.check_free_space(found_.front());
    measure_finely();
  }

  // Whether the best pose is so surely right that nothing else is searched for.
  bool is_settled() const {
    return !found_.empty() && found_.front().registration.rests &&
           map_.calibration.ends_search(features_of(found_, map_, query_.spots), map_.ranking);
  }

  // Whether the last run left out a place that would tie with a pose, as a known alias.
  bool leaves_out(const RegisteredPose& best, const std::vector<PoseMatrix>& aliases) const {
    return !order_.tied_aliases(best, aliases).empty();
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
      const PoseMatrix& T = candidates[i].T_level_sensor;
      const bool is_known = std::any_of(known.begin(), known.end(),
                                        [&](const PoseMatrix& other) { return is_same_pose(T, other, within_m, cosine); });
      if (!is_known) fresh.push_back(static_cast<std::int64_t>(i));
    }
    return fresh;
  }

 private:
  // Aligns all new candidates with few points: coarsely, then the good ones on the map's own points.
  void align(const std::vector<Candidate>& candidates, const KnownTwist& twist) {
    std::vector<Candidate> fresh;
    for (const auto row : untried(candidates, twist)) fresh.push_back(candidates[static_cast<std::size_t>(row)]);
    if (fresh.empty()) return;
    std::vector<Registration> near = aligned_coarsely(fresh, twist);
    double best = near.front().alignment_score;
    for (const Registration& one : near) best = std::max(best, one.alignment_score);
    for (const Candidate& one : fresh) tried_.push_back(one.T_level_sensor);
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

  std::vector<Registration> aligned_coarsely(const std::vector<Candidate>& candidates, const KnownTwist& twist) {
    const auto align_all = [&](Aligner& coarse) {
      std::vector<Registration> made;
      for (const Candidate& one : candidates) {
        made.push_back(coarse.align(one.T_level_sensor, map_.coarsely(), map_.registration.coarse_voxel_m));
      }
      return made;
    };
    if (!twist || !query_.is_in_time()) return align_all(coarse_);
    const ScannedSurface still =
        at_most(deskewed(query_.sparse, *twist), map_.ranking.coarse_points, map_.registration.coarse_voxel_m);
    Aligner coarse(map_.coarse, still);
    return align_all(coarse);
  }

  // The best ones that may compete, of all runs: distinct poses that the prior allows, best first.
  RegisteredPoses registered() {
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < aligned_.size(); ++i) {
      if (allows(aligned_[i].rigid.T_level_sensor)) rows.push_back(i);
    }
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
    for (const RegisteredPose& one : beside_in_order_) {
      if (allows(one)) made.push_back(one);
    }
    // the motion may have changed the order, and an unlikely one counts against a place
    std::stable_sort(made.begin(), made.end(), [](const RegisteredPose& a, const RegisteredPose& b) {
      return a.fit.alignment_score > b.fit.alignment_score;
    });
    return made;
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

  // The poses that the prior allows, best first, the best one's agreement with many points.
  void measure_finely() {
    RegisteredPoses allowed;
    for (const RegisteredPose& one : found_) {
      if (allows(one)) allowed.push_back(one);
    }
    found_ = ranked(std::move(allowed), map_.ranking);
    for (std::size_t i = 0; i < found_.size(); ++i) {
      if (i == 0) measures_.measure_finely(found_[i]);
      else measures_.measure(found_[i]);
    }
  }

  bool allows(const PoseMatrix& T_level_sensor) const {
    return !prior_ || prior_->allows(detail::product(map_.T_map_level, T_level_sensor));
  }
  bool allows(const RegisteredPose& one) const { return allows(one.registration.T_level_sensor); }

  const SearchedMap& map_;
  const SearchedQuery& query_;
  std::optional<Prior> prior_;
  ScannedSurface coarsest_, fewest_;  // parts of the sparse points
  Aligner coarse_;
  ScanOnMap fewest_on_map_, few_, many_;
  PlaceMeasures measures_;
  FreeSpaceOrder order_;
  MinimaBeside minima_;
  std::optional<MotionAtPlaces> in_motion_;
  std::vector<PoseMatrix> tried_;  // all starts
  std::vector<AlignedStart> aligned_;
  std::map<PoseMatrix, std::optional<RegisteredPose>> beside_;  // by pose: the better one beside it
  RegisteredPoses beside_in_order_;                             // as they were found
  RegisteredPoses found_;
};

}  // namespace firstfix
