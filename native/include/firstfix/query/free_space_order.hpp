// Which poses have their free space checked, and when the check ends.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "firstfix/query/place_measures.hpp"
#include "firstfix/query/registered_pose.hpp"

namespace firstfix {

constexpr double kNearOnLevelM = 2.0;  // templates stand a metre apart
constexpr double kStoreyM = 1.5;       // in height, at least: of a floor above another

// Whether a pose is above or below another one, on another storey.
inline bool is_stacked(const PoseMatrix& T, const PoseMatrix& other) {
  return std::hypot(other[3] - T[3], other[7] - T[7]) < kNearOnLevelM && std::fabs(other[11] - T[11]) > kStoreyM;
}

// Whether a motion was solved that moves points by more than a few centimetres.
inline bool is_in_motion(const Registration& placed) {
  return placed.twist && (detail::length(&(*placed.twist)[0]) > kSlowMS || detail::length(&(*placed.twist)[3]) > kSlowRadS);
}

// Whether a known alias of the best place may tie with it, before its free space is checked.
inline bool may_tie(const RegisteredPose& best, const RegisteredPose& alias, const SearchedMap& map) {
  const bool is_doubtful = is_in_motion(best.registration) ||
                           is_stacked(best.registration.T_level_sensor, alias.registration.T_level_sensor);
  const double reach = is_doubtful ? map.ranking.rival_within : map.calibration.alias_margin;
  return best.support - alias.support < reach;
}

// Checks the free space of the poses that may be the best or its best rival.
class FreeSpaceOrder {
 public:
  FreeSpaceOrder(const SearchedMap& map, PlaceMeasures& measures, std::size_t spots)
      : map_(map), measures_(measures), spots_(spots) {}

  // The check only lowers support. So it stops at the first pose that is too weak already, or that could not keep the best
  // one from being accepted. Known aliases of the best one tie sooner: of what is left they are checked, too.
  //
  // registered: in the order of the support that they have at most. aliases: poses of the known aliases.
  RegisteredPoses checked(const RegisteredPoses& registered, const std::vector<PoseMatrix>& aliases) {
    RegisteredPoses checked;
    unchecked_.clear();
    for (std::size_t i = 0; i < registered.size(); ++i) {
      if (checked.size() > 1) {
        measures_.measure(checked.front());
        if (is_settled(checked, registered[i])) {
          unchecked_.assign(registered.begin() + static_cast<std::ptrdiff_t>(i), registered.end());
          for (RegisteredPose& alias : tied_aliases(checked.front(), aliases)) {
            measures_.check_free_space(alias);
            checked.push_back(alias);
          }
          break;
        }
      }
      RegisteredPose one = registered[i];
      measures_.check_free_space(one);
      checked.insert(std::upper_bound(checked.begin(), checked.end(), one, has_more_support), one);
    }
    if (!checked.empty()) measures_.measure(checked.front());
    return checked;
  }

  // The poses that were not checked at known aliases of the best one, near enough to it to tie.
  RegisteredPoses tied_aliases(const RegisteredPose& best, const std::vector<PoseMatrix>& aliases) const {
    RegisteredPoses tied;
    const double cosine = std::cos(radians(map_.ranking.same_pose_deg));
    for (const RegisteredPose& one : unchecked_) {
      if (!may_tie(best, one, map_)) continue;
      for (const PoseMatrix& alias : aliases) {
        if (!is_same_pose(one.registration.T_level_sensor, alias, map_.ranking.same_pose_m, cosine)) continue;
        tied.push_back(one);
        break;
      }
    }
    return tied;
  }

 private:
  // Whether no pose from the following one on can change the answer, but known aliases. checked: best first.
  bool is_settled(const RegisteredPoses& checked, const RegisteredPose& following) const {
    const double least = std::min(checked[1].support, checked[0].support - map_.ranking.rival_within);
    if (following.support < least) return true;
    return map_.calibration.ends_search(features_of(checked, map_, spots_, &following), map_.ranking);
  }

  const SearchedMap& map_;
  PlaceMeasures& measures_;
  std::size_t spots_;
  RegisteredPoses unchecked_;  // of the last order, where it stopped
};

}  // namespace firstfix
