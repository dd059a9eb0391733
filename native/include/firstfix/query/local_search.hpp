// Local search: a better alignment within a few metres of a place (docs/method.md section 7.2).
//
// Alignment brings a pose to the right minimum from a quarter of a metre, while templates stand up to two metres apart. So the
// best place may be a wrong minimum beside the right one: the next panel, or the next parked car.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "firstfix/bit_exact/cholesky.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/scan_on_map.hpp"
#include "firstfix/registration/distinct_poses.hpp"

namespace firstfix {

using LevelOffset = std::array<double, 2>;  // metres, in the level frame

namespace detail {

// Numbers from one to another, the other one excluded.
inline std::vector<double> line(double first, double end, double step) {
  std::vector<double> made;
  const auto count = static_cast<int>(std::ceil((end - first) / step));
  for (int i = 0; i < count; ++i) made.push_back(first + i * step);
  return made;
}

// The level direction that a scan constrains least: along which the covariance of the pose is largest.
inline LevelOffset loosest_direction(const Matrix6& information) {
  double covariance[2][2];  // of x and y
  for (std::size_t axis = 0; axis < 2; ++axis) {
    Matrix6 certain = information;
    for (std::size_t k = 0; k < 6; ++k) certain[7 * k] += 1;  // of a scan that constrains nothing
    double column[6] = {};
    column[3 + axis] = 1;
    solve_definite<6>(certain.data(), column);
    covariance[axis][0] = column[3], covariance[axis][1] = column[4];
  }
  const double angle = std::atan2(covariance[0][1] + covariance[1][0], covariance[0][0] - covariance[1][1]) / 2;
  return {std::cos(angle), std::sin(angle)};
}

}  // namespace detail

// Offsets of starts all around a place.
inline std::vector<LevelOffset> offsets_around(const NearbyNumbers& nearby) {
  std::vector<LevelOffset> offsets;
  const std::vector<double> line = detail::line(-nearby.reach_m, nearby.reach_m + nearby.step_m / 2, nearby.step_m);
  for (const double y : line) {
    for (const double x : line) {
      const double far_m = std::hypot(x, y);
      if (far_m > 0 && far_m <= nearby.reach_m + 1e-9) offsets.push_back({x, y});
    }
  }
  return offsets;
}

// Offsets of starts along the level direction that the scan constrains least.
inline std::vector<LevelOffset> offsets_along(const NearbyNumbers& nearby, const Matrix6& information) {
  const LevelOffset direction = detail::loosest_direction(information);
  std::vector<LevelOffset> offsets;
  const std::vector<double> line = detail::line(nearby.step_m, nearby.reach_m + nearby.step_m / 2, nearby.step_m);
  for (const double way : {-1.0, 1.0}) {
    for (const double off : line) offsets.push_back({way * off * direction[0], way * off * direction[1]});
  }
  return offsets;
}

// The best alignment from starts beside an aligned pose; nothing: none is better than the pose itself. All starts are aligned
// with few points, deskewed by the pose's motion, the best few and the pose itself with many.
inline std::optional<Registration> best_near(const SearchedMap& map, ScanOnMap& fewest, ScanOnMap& many,
                                             const Registration& placed, const std::vector<LevelOffset>& offsets) {
  const NearbyNumbers& nearby = map.nearby;
  std::vector<Registration> aligned;
  fewest.seen(placed.twist, [&](Aligner& few) {
    const auto add = [&](const LevelOffset& offset) {
      PoseMatrix T = placed.T_level_sensor;
      T[3] += offset[0], T[7] += offset[1];
      aligned.push_back(few.align(T, map.usually(), map.registration.inlier_distance_m));
    };
    add({0, 0});
    for (const LevelOffset& offset : offsets) add(offset);
  });
  const double least = aligned.front().alignment_score - nearby.worse_by;
  std::stable_sort(aligned.begin() + 1, aligned.end(),
                   [](const Registration& a, const Registration& b) { return a.alignment_score > b.alignment_score; });
  std::vector<PoseMatrix> ends{aligned.front().T_level_sensor};
  for (std::size_t i = 1; i < aligned.size() && aligned[i].alignment_score > least; ++i) {
    ends.push_back(aligned[i].T_level_sensor);
  }
  // the first is the place itself, where some of the starts end too
  const auto apart = distinct_poses(ends, nearby.apart_m, radians(nearby.apart_deg), nearby.refined + 1);
  if (apart.size() < 2) return std::nullopt;
  std::vector<PoseMatrix> starts{placed.T_level_sensor};
  for (std::size_t i = 1; i < apart.size(); ++i) starts.push_back(ends[static_cast<std::size_t>(apart[i])]);
  const std::vector<Registration> refined =
      many.align_finely(starts, std::vector<KnownTwist>(starts.size(), placed.twist));
  const auto best = std::max_element(refined.begin(), refined.end(), [](const Registration& a, const Registration& b) {
    return a.alignment_score < b.alignment_score;
  });
  if (!(best->alignment_score > refined.front().alignment_score + nearby.better_by)) return std::nullopt;
  return *best;
}

}  // namespace firstfix
