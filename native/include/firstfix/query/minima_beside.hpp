// The best minimum at a place and beside it: the next panel, a wall's other face, the floor under a pose that slid up.
#pragma once

#include <cmath>
#include <cstddef>
#include <map>
#include <vector>

#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/scan_on_map.hpp"

namespace firstfix {

// Aligns poses again with many points. Each pose is refined once.
class MinimaBeside {
 public:
  MinimaBeside(const SearchedMap& map, ScanOnMap& few, ScanOnMap& many) : map_(map), few_(few), many_(many) {}

  // The pose, or one beside it that is clearly better, aligned finely. A scan in motion is compared as the pose's own motion
  // deskews it: a skewed one fits best where it is askew.
  const Registration& refined(const RegisteredPose& one) {
    const auto [known, is_first] = refined_.try_emplace(one.registration.T_level_sensor);
    if (is_first) known->second = many_.align_finely({best_minimum(one)}, {one.registration.twist}).front();
    return known->second;
  }

 private:
  std::vector<PoseMatrix> starts_beside(const RegisteredPose& one) const {
    const PoseMatrix& T = one.registration.T_level_sensor;
    std::vector<PoseMatrix> starts{T};
    for (int x = 0; x < 3; ++x) {
      for (int y = 0; y < 3; ++y) {
        if (x == 0 && y == 0) continue;
        starts.push_back(T);
        starts.back()[3] += map_.ranking.neighbour_m * kBeside[x];
        starts.back()[7] += map_.ranking.neighbour_m * kBeside[y];
      }
    }
    const double risen_m = one.start_z_m - T[11];
    if (std::fabs(risen_m) > map_.ranking.slid_m) {
      starts.push_back(T);
      starts.back()[11] += risen_m;
    }
    return starts;
  }

  PoseMatrix best_minimum(const RegisteredPose& one) {
    const double inlier_m = map_.registration.inlier_distance_m;
    std::vector<PoseMatrix> minima;  // the pose's own, and the best beside it if it may be better
    few_.seen(one.registration.twist, [&](Aligner& few) {
      Registration own, beside;
      bool is_first = true;
      for (const PoseMatrix& T : starts_beside(one)) {
        const Registration found = few.align(T, map_.usually(), inlier_m);
        if (is_first) own = found;
        else if (found.alignment_score > beside.alignment_score) beside = found;
        is_first = false;
      }
      minima.push_back(own.T_level_sensor);
      const bool may_be_better = beside.alignment_score > own.alignment_score + map_.ranking.maybe_better_by;
      if (may_be_better) minima.push_back(beside.T_level_sensor);
    });
    // few points may mistake which is better, and by how much: many points decide
    return many_.seen(one.registration.twist, [&](Aligner& many) {
      const Registration own = many.align(minima.front(), map_.smoothly(), inlier_m);
      if (minima.size() == 1) return own.T_level_sensor;
      const Registration beside = many.align(minima.back(), map_.smoothly(), inlier_m);
      const bool is_better = beside.alignment_score > own.alignment_score + map_.ranking.better_by;
      return is_better ? beside.T_level_sensor : own.T_level_sensor;
    });
  }

  static constexpr double kBeside[3] = {0, -1, 1};

  const SearchedMap& map_;
  ScanOnMap &few_, &many_;
  std::map<PoseMatrix, Registration> refined_;
};

}  // namespace firstfix
