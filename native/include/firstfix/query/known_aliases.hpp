// Known aliases: places that look like that of a pose, and the places right above and below it (docs/method.md section 7.1).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <optional>
#include <vector>

#include "firstfix/query/candidate.hpp"
#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/scan_on_map.hpp"
#include "firstfix/registration/distinct_poses.hpp"

namespace firstfix {

// Tells which aliases of a pose may change the answer: most poses have none, and need not be judged again.
class KnownAliases {
 public:
  KnownAliases(const SearchedMap& map, const SearchedQuery& query, const Deadline& deadline, ScanOnCells& coarse, ScanOnMap& few)
      : map_(map), query_(query), deadline_(deadline), coarse_(coarse), few_(few) {}

  // First all but those right above and below are screened together with the pose. Those that are not far behind it are then
  // aligned with few points, and so is the pose: with many points it would look better than its aliases for that reason
  // alone. Free space is not checked at the aliases: it only lowers support. A scan in motion is deskewed by the motion at the
  // pose, which it would have at an alias as well.
  //
  // Returns rows of the aliases, most alike first. best: the pose that would be answered. needed: probability from which on
  // it is accepted.
  std::vector<std::int64_t> rivals(const std::vector<Candidate>& aliases, const RegisteredPose& best, double needed) {
    const KnownTwist& twist = best.registration.twist;
    const std::vector<std::int64_t> rows = worth_aligning(aliases, best);
    if (rows.empty()) return {};
    std::vector<PoseMatrix> starts{best.registration.T_level_sensor};
    for (const std::int64_t row : rows) starts.push_back(aliases[static_cast<std::size_t>(row)].T_level_sensor);
    const std::vector<Registration> near = coarse_.align(starts, twist, map_.coarsely());
    std::vector<Registration> placed;
    few_.seen(twist, [&](Aligner& few) {
      for (const Registration& one : near) {
        placed.push_back(few.align(one.T_level_sensor, map_.usually(), map_.registration.inlier_distance_m));
      }
    });
    std::vector<std::int64_t> found;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (is_rival(best, placed.front(), placed[i + 1], needed)) found.push_back(rows[i]);
    }
    return found;
  }

  // Rows of the few aliases of a pose at which a probe finds the scan to fit nearly as well, best first.
  std::vector<std::int64_t> not_far_behind(const std::vector<PoseMatrix>& aliases, const PoseMatrix& T_level_sensor,
                                           const KnownTwist& twist) {
    if (aliases.empty()) return {};
    if (!probe_) probe_.emplace(map_, query_.sparse, map_.ranking.screen_points, deadline_);
    std::vector<PoseMatrix> starts{T_level_sensor};
    starts.insert(starts.end(), aliases.begin(), aliases.end());
    const std::vector<Registration> screened = probe_->align(starts, twist, map_.barely());
    const auto score = [&](std::int64_t row) { return screened[static_cast<std::size_t>(row) + 1].alignment_score; };
    std::vector<std::int64_t> rows(aliases.size());
    std::iota(rows.begin(), rows.end(), 0);
    std::stable_sort(rows.begin(), rows.end(), [&](std::int64_t a, std::int64_t b) { return score(a) > score(b); });
    rows.resize(std::min(rows.size(), map_.aliases.tried));
    const double least = screened.front().alignment_score - map_.aliases.behind;
    rows.erase(std::remove_if(rows.begin(), rows.end(), [&](std::int64_t row) { return !(score(row) >= least); }), rows.end());
    return rows;
  }

 private:
  // Those right above and below, and those that are not far behind; most alike first.
  std::vector<std::int64_t> worth_aligning(const std::vector<Candidate>& aliases, const RegisteredPose& best) {
    const PoseMatrix& T_best = best.registration.T_level_sensor;
    std::vector<std::int64_t> rows, beside;
    std::vector<PoseMatrix> beside_poses;
    for (std::size_t i = 0; i < aliases.size(); ++i) {
      const bool stacked = is_stacked(T_best, aliases[i].T_level_sensor);
      (stacked ? rows : beside).push_back(static_cast<std::int64_t>(i));
      if (!stacked) beside_poses.push_back(aliases[i].T_level_sensor);
    }
    for (const std::int64_t k : not_far_behind(beside_poses, T_best, best.registration.twist)) {
      rows.push_back(beside[static_cast<std::size_t>(k)]);
    }
    std::stable_sort(rows.begin(), rows.end(), [&](std::int64_t a, std::int64_t b) {
      return aliases[static_cast<std::size_t>(a)].score > aliases[static_cast<std::size_t>(b)].score;
    });
    return rows;
  }

  bool is_rival(const RegisteredPose& best, const Registration& own, const Registration& alias, double needed) const {
    const Ranking& ranking = map_.ranking;
    const double cosine = std::cos(radians(ranking.same_pose_deg));
    if (is_same_pose(alias.T_level_sensor, best.registration.T_level_sensor, ranking.same_pose_m, cosine)) {
      return alias.alignment_score > own.alignment_score + ranking.maybe_better_by;  // a minimum of the same place
    }
    RegisteredPose placed = best;
    placed.registration = own;
    placed.fit.inlier_ratio = own.inlier_ratio, placed.fit.alignment_score = own.alignment_score;
    placed.support = ranking.support(placed.fit);
    const RegisteredPose other(ranking, 0, 0, alias);
    if (may_tie(placed, other, map_)) return true;
    const double lead = static_cast<double>(query_.spots) * (placed.support - other.support);
    return !map_.calibration.accepts({best.fit, lead, 1}, ranking, needed);
  }

  const SearchedMap& map_;
  const SearchedQuery& query_;
  const Deadline& deadline_;
  std::optional<ScanOnCells> probe_;  // fewer points yet; most queries ask for none
  ScanOnCells& coarse_;
  ScanOnMap& few_;
};

}  // namespace firstfix
