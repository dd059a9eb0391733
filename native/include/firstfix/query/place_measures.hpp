// What tells places apart beside their alignment: free space, and how the scan agrees with the map.
#pragma once

#include <map>
#include <utility>

#include "firstfix/query/motion_at_places.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/scan_on_map.hpp"
#include "firstfix/verification/free_space.hpp"

namespace firstfix {

// Measures poses of one query. What was measured at a pose once is known there.
class PlaceMeasures {
 public:
  PlaceMeasures(const SearchedMap& map, const SearchedQuery& query, ScanOnMap& few, ScanOnMap& many)
      : map_(map), query_(query), few_(few), many_(many) {}

  // The support that a pose has at most, whatever passes through the map there: seen-free space costs a hundredth of the check.
  double most_support(const RegisteredPose& one) {
    Fit fit = one.fit;
    fit.seen_free = seen_free(one.registration);
    return map_.ranking.support(fit);
  }

  bool is_checked(const RegisteredPose& one) const { return free_space_.count(one.registration.T_level_sensor) != 0; }

  // Checks the shares of directions that pass through the map, as means over the query's scans.
  void check_free_space(RegisteredPose& one) {
    const auto [known, is_first] = free_space_.try_emplace(one.registration.T_level_sensor);
    if (is_first) known->second = free_space_at(one.registration);
    one.fit.free_space_violation = known->second.violation, one.fit.removed_surface = known->second.removed;
    one.fit.seen_free = seen_free(one.registration);
    one.support = map_.ranking.support(one.fit);
  }

  // Measures how the few points agree with the map, unless the agreement is known.
  void measure(RegisteredPose& one) { take(one, few_, agreement_, !one.is_measured); }

  // The same with many points, always.
  void measure_finely(RegisteredPose& one) { take(one, many_, fine_agreement_, true); }

 private:
  struct Shares {
    double violation = 0, removed = 0;
  };
  using Agreements = std::map<PoseMatrix, Agreement>;

  void take(RegisteredPose& one, ScanOnMap& scan, Agreements& known_ones, bool is_wanted) {
    if (!is_wanted) return;
    const PoseMatrix& T = one.registration.T_level_sensor;
    auto known = known_ones.find(T);
    if (known == known_ones.end()) {
      const Agreement found = scan.seen(one.registration.twist, [&](Aligner& seen) {
        return seen.agreement(map_.coarse, T, map_.registration.inlier_distance_m);
      });
      known = known_ones.emplace(T, found).first;
    }
    one.fit.beside_surface = known->second.beside_surface, one.fit.same_plane = known->second.same_plane;
    one.is_measured = true;
  }

  Shares free_space_at(const Registration& placed) const {
    Shares shares;
    for (const ViewedScan& scan : query_.scans) {
      const PoseMatrix T_level_scan = detail::product(placed.T_level_sensor, scan.T_last_scan);
      const auto seen_in = [&](const RangeView& view) {
        return seen_through(map_.near, map_.far, map_.reach_m, map_.coarse, view.returned.data(), view.least_m.data(),
                            T_level_scan);
      };
      const bool is_moved = placed.twist && scan.returns.times() != nullptr;
      const SeenThrough seen = is_moved ? seen_in(scan.deskewed(*placed.twist)) : seen_in(scan.view);
      shares.violation += seen.onto_nothing, shares.removed += seen.onto_surface;
    }
    const auto count = static_cast<double>(query_.scans.size());
    shares.violation /= count, shares.removed /= count;
    return shares;
  }

  double seen_free(const Registration& placed) {
    const auto [known, is_first] = seen_free_.try_emplace(placed.T_level_sensor);
    if (is_first) known->second = seen_free_at(placed);
    return known->second;
  }

  // Share of the few points, of all scans, in space that the mapping run saw free.
  double seen_free_at(const Registration& placed) const {
    if (!map_.seen_free) return std::numeric_limits<double>::quiet_NaN();
    const auto share = [&](const ScannedSurface& scan) {
      return map_.seen_free->share(scan.at.points.data(), scan.size(), placed.T_level_sensor);
    };
    return placed.twist && query_.is_in_time() ? share(deskewed(query_.sparse, *placed.twist)) : share(query_.sparse);
  }

  const SearchedMap& map_;
  const SearchedQuery& query_;
  ScanOnMap &few_, &many_;
  std::map<PoseMatrix, Shares> free_space_;
  std::map<PoseMatrix, double> seen_free_;
  Agreements agreement_, fine_agreement_;
};

}  // namespace firstfix
