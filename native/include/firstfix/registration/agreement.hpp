// How a placed scan agrees with the map, beyond how much of it does (docs/method.md section 7).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/registration/pairs.hpp"
#include "firstfix/registration/scan_surface.hpp"
#include "firstfix/registration/surface_grid.hpp"

namespace firstfix {

constexpr float kUpright = 0.5F;  // |z| of a normal that is less: no floor, no ceiling

// beside_surface: share of the scan's points that lie near a surface of the map, but on none.
// same_plane: chance that two of the upright points that lie on the map lie on one plane; 1 without two such points.
struct Agreement {
  double beside_surface, same_plane;
};

namespace detail {

// Counts pairs of points that lie on one plane: the same direction of the normal, and distance from the sensor.
class PlanePairs {
 public:
  PlanePairs() : count_(kSectors * kDistances) {}

  // normal_x, normal_y: level. away_m: distance of the plane.
  void add(float normal_x, float normal_y, float away_m) {
    const float turns = atan2_turns(normal_y, normal_x);
    const bool is_number = turns >= -0.5F && turns <= 0.5F;
    const int sector = is_number ? static_cast<int>(turns * kSectors + (kSectors / 2 + 0.5F)) % kSectors : 0;
    const float scaled = away_m * kPerM + 0.5F;
    const int distance = scaled < kDistances - 1 ? static_cast<int>(scaled) : kDistances - 1;
    same_ += count_[static_cast<std::size_t>(sector * kDistances + distance)]++;
    ++points_;
  }

  double same_share() const {
    if (points_ < 2) return 1;
    return static_cast<double>(same_) / (static_cast<double>(points_) * static_cast<double>(points_ - 1) / 2);
  }

 private:
  static constexpr int kSectors = 16, kDistances = 256;
  static constexpr float kPerM = 2;  // planes half a metre apart are different ones
  std::vector<std::int32_t> count_;
  std::int64_t same_ = 0, points_ = 0;
};

}  // namespace detail

// finder: of the scan in the fine grid. coarse: a coarser grid of the same map, which says what is near.
inline Agreement agreement_at(PairFinder& finder, const SurfaceGrid& coarse, const ScanSurface& scan,
                              const PoseMatrix& T_level_sensor, float inlier_distance_m) {
  const FloatPose pose(T_level_sensor, coarse.corner_m);
  const auto& R = pose.R;
  detail::PlanePairs planes;
  std::vector<float> off_surface;  // relative to the coarse grid's corner
  std::size_t first = 0;
  finder.each8(T_level_sensor, [&](const Pairs8& pairs) {
    const Float8 share = pairs.off_m / inlier_distance_m, square = share * share;
    for (std::size_t lane = 0; lane < std::min(kLanes, scan.count - first); ++lane) {
      const std::size_t i = first + lane;
      if (pairs.normal[0][lane] == 0 && pairs.normal[1][lane] == 0 && pairs.normal[2][lane] == 0) {
        for (int axis = 0; axis < 3; ++axis) off_surface.push_back(pairs.arm[axis][lane] + pose.t[axis]);
      } else if (square[lane] <= 1.0F) {
        const float x = scan.nx[i], y = scan.ny[i], z = scan.nz[i];
        if (!(std::fabs(R[6] * x + R[7] * y + R[8] * z) < kUpright)) continue;
        planes.add(R[0] * x + R[1] * y + R[2] * z, R[3] * x + R[4] * y + R[5] * z,
                   std::fabs(scan.x[i] * x + scan.y[i] * y + scan.z[i] * z));
      }
    }
    first += kLanes;
  });
  const auto beside = static_cast<double>(near_surface(coarse, off_surface));
  return {beside / static_cast<double>(std::max<std::size_t>(scan.count, 1)), planes.same_share()};
}

}  // namespace firstfix
