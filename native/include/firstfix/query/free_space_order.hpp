// Which poses have their free space checked, and when the check ends.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "firstfix/query/place_measures.hpp"
#include "firstfix/query/registered_pose.hpp"

namespace firstfix {

constexpr double kStackedWithinM = 2.0;  // templates stand a metre apart
constexpr double kStoreyM = 1.5;       // in height, at least: of a floor above another

// Probability below which a place is hopeless: then its rivals are not counted, and they could not move it by more.
constexpr double kHopelessBelow = 0.01;
// Probability that a pose has at most, from which on it may be sure once it is aligned finely.
constexpr double kMayBeSure = 0.5;
// Poses, best by alignment first: where none of so many may be sure, those that fit worse are no answer either: no
// verdict of some 1,000 scans is another one by this and its like (lab/docs/experiments.md, hard scans).
constexpr std::size_t kEnoughUnsure = 12;

// Whether a position, (3,), is above or below another one, on another storey.
inline bool is_stacked(const double* at_m, const double* other_m) {
  return std::hypot(other_m[0] - at_m[0], other_m[1] - at_m[1]) < kStackedWithinM && std::fabs(other_m[2] - at_m[2]) > kStoreyM;
}

inline bool is_stacked(const PoseMatrix& T, const PoseMatrix& other) {
  const double at_m[3] = {T[3], T[7], T[11]}, other_m[3] = {other[3], other[7], other[11]};
  return is_stacked(at_m, other_m);
}

// Whether a pose is nearly the same as one of some others.
inline bool is_any_of(const PoseMatrix& T, const std::vector<PoseMatrix>& others, double within_m, double cosine) {
  return std::any_of(others.begin(), others.end(),
                     [&](const PoseMatrix& other) { return is_same_pose(T, other, within_m, cosine); });
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
  // one from being accepted, or where the best one is hopeless. Of the others, poses that are surely outdone are left out, and
  // those after many unsure ones, unless an earlier order has checked them. Known aliases of the best one tie sooner: of what is
  // left they are checked, too.
  //
  // registered: in the order of the support that they have at most. aliases: poses of the known aliases.
  RegisteredPoses checked(const RegisteredPoses& registered, const std::vector<PoseMatrix>& aliases) {
    RegisteredPoses checked;
    unchecked_.clear();
    for (std::size_t i = 0; i < registered.size(); ++i) {
      if (checked.size() > 1) {
        measures_.measure(checked.front());
        if (is_settled(checked, registered[i])) {
          unchecked_.insert(unchecked_.end(), registered.begin() + static_cast<std::ptrdiff_t>(i), registered.end());
          break;
        }
      }
      RegisteredPose one = registered[i];
      if (!measures_.is_checked(one) && (are_unsure(checked) || is_outdone(checked, one))) {
        unchecked_.push_back(one);
        continue;
      }
      measures_.check_free_space(one);
      checked.insert(std::upper_bound(checked.begin(), checked.end(), one, has_more_support), one);
    }
    if (checked.empty()) return checked;
    for (RegisteredPose& alias : tied_aliases(checked.front(), aliases)) {
      measures_.check_free_space(alias);
      checked.push_back(alias);
    }
    measures_.measure(checked.front());
    return checked;
  }

  // The poses that were not checked at known aliases of the best one, near enough to it to tie.
  RegisteredPoses tied_aliases(const RegisteredPose& best, const std::vector<PoseMatrix>& aliases) const {
    RegisteredPoses tied;
    const double cosine = std::cos(radians(map_.ranking.same_pose_deg));
    for (const RegisteredPose& one : unchecked_) {
      const bool is_alias = is_any_of(one.registration.T_level_sensor, aliases, map_.ranking.same_pose_m, cosine);
      if (is_alias && may_tie(best, one, map_)) tied.push_back(one);
    }
    return tied;
  }

 private:
  // Whether no pose from the following one on can change the answer, but known aliases. checked: best first.
  bool is_settled(const RegisteredPoses& checked, const RegisteredPose& following) const {
    const double least = std::min(checked[1].support, checked[0].support - map_.ranking.rival_within);
    if (following.support < least || is_hopeless(checked[0], following)) return true;
    return map_.calibration.ends_search(features_of(checked, map_, spots_, &following), map_.ranking);
  }

  // Whether the best place can be no answer, even without rivals, and no better one follows. It is not refined either.
  bool is_hopeless(const RegisteredPose& best, const RegisteredPose& following) const {
    const double likely = std::min(kHopelessBelow, map_.ranking.promising);
    return !map_.calibration.is_prior && following.support < best.support &&
           map_.calibration.most(best.fit, map_.ranking) < likely;
  }

  // Whether so many poses are no answer that none of the following ones is. In motion, each fits better than it is aligned.
  bool are_unsure(RegisteredPoses& checked) {
    if (checked.size() < kEnoughUnsure || map_.calibration.is_prior || checked.front().registration.twist) return false;
    return std::none_of(checked.begin(), checked.end(), [&](RegisteredPose& one) {
      measures_.measure(one);
      return map_.calibration.most(one.fit, map_.ranking) >= kMayBeSure;
    });
  }

  // Whether a pose is surely behind all that are refined, the last of which does not tie with the best one: so it is no best
  // rival either. One that may look alike, in motion or on another storey, is compared at any support. checked: best first.
  bool is_outdone(const RegisteredPoses& checked, const RegisteredPose& one) const {
    if (checked.size() < map_.ranking.max_refined || checked.size() < 2) return false;
    const RegisteredPose &best = checked.front(), &last = checked[map_.ranking.max_refined - 1];
    const double tie = std::max(map_.calibration.min_margin, map_.calibration.alias_margin);
    const bool may_look_alike =
        is_in_motion(best.registration) || is_stacked(best.registration.T_level_sensor, one.registration.T_level_sensor);
    return !may_look_alike && best.support - last.support > tie && measures_.most_support(one) < last.support;
  }

  const SearchedMap& map_;
  PlaceMeasures& measures_;
  std::size_t spots_;
  RegisteredPoses unchecked_;  // of the last order
};

}  // namespace firstfix
