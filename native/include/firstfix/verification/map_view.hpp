// The map as it is seen from a pose: the nearest surface in each direction, by a z-buffer of the map's points.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/verification/point_tiles.hpp"

namespace firstfix {

// Rows of a range view, from the lowest to the highest, both included.
struct RowBand {
  int lowest = 0, highest = static_cast<int>(kViewRows) - 1;

  // The rows in which a scan has returns. Without any, no row.
  static RowBand of(const std::uint8_t* returned) {
    RowBand band{static_cast<int>(kViewRows), -1};
    for (int row = 0; row < static_cast<int>(kViewRows); ++row) {
      std::uint8_t some = 0;
      for (std::size_t column = 0; column < kViewColumns; ++column) some |= returned[row * kViewColumns + column];
      if (some == 0) continue;
      if (band.highest < 0) band.lowest = row;
      band.highest = row;
    }
    return band;
  }
};

// Draws points into a range view as long as they lie in a band of its rows. Points outside of it may be drawn, too.
class MapView {
 public:
  // nearest: (directions,), infinite where nothing has been drawn. It must outlive this.
  MapView(const PoseMatrix& T_map_sensor, const RowBand& band, float* nearest)
      : nearest_(nearest), pose_(T_map_sensor), centre_m_{T_map_sensor[3], T_map_sensor[7], T_map_sensor[11]} {
    constexpr double kMarginDeg = 0.05;
    const double bottom_deg = 2.0 * band.lowest - 90 - kMarginDeg, top_deg = 2.0 * band.highest - 88 + kMarginDeg;
    if (band.lowest > 0) bottom_ = {static_cast<float>(std::tan(bottom_deg * detail::kPi / 180)), 0};
    if (band.highest + 1 < static_cast<int>(kViewRows)) top_ = {static_cast<float>(std::tan(top_deg * detail::kPi / 180)), 0};
  }

  // Draws the points within reach.
  void draw(const PointTiles& tiles, double reach_m) {
    const auto reach2 = static_cast<float>(reach_m * reach_m);
    tiles.each_run(centre_m_, reach_m, [&](std::int64_t first, std::int64_t end) {
      for (; first < end; first += kBlock) {
        take(tiles.points + 3 * first, static_cast<std::size_t>(std::min<std::int64_t>(kBlock, end - first)), reach2);
      }
    });
    nearest_by_direction(held_, held_count_, nearest_);
    held_count_ = 0;
  }

 private:
  static constexpr std::size_t kBlock = 256;

  struct Cone {  // points at slope * distance across + offset
    float slope, offset;
    float at(float across) const { return slope * across + offset; }
  };

  float* nearest_;
  FloatPose pose_;
  double centre_m_[3];
  Cone bottom_{0, -1e30F}, top_{0, 1e30F};
  float held_[3 * 2 * kBlock];  // points that wait to be drawn, less than a block of them
  std::size_t held_count_ = 0;

  // Keeps those of some points that lie within reach and in the band; draws full blocks.
  void take(const float* points, std::size_t count, float reach2) {
    float x[kBlock], y[kBlock], z[kBlock];
    std::int32_t is_seen[kBlock];
    const auto& [R, centre] = pose_;
    for (std::size_t i = 0; i < count; ++i) {
      const float dx = points[3 * i] - centre[0], dy = points[3 * i + 1] - centre[1], dz = points[3 * i + 2] - centre[2];
      x[i] = dx * R[0] + dy * R[3] + dz * R[6];
      y[i] = dx * R[1] + dy * R[4] + dz * R[7];
      z[i] = dx * R[2] + dy * R[5] + dz * R[8];
      const float across = std::sqrt(x[i] * x[i] + y[i] * y[i]);
      is_seen[i] = (dx * dx + dy * dy + dz * dz < reach2) & (z[i] >= bottom_.at(across)) & (z[i] <= top_.at(across));
    }
    for (std::size_t i = 0; i < count; ++i) {
      float* next = held_ + 3 * held_count_;
      next[0] = x[i], next[1] = y[i], next[2] = z[i];
      held_count_ += static_cast<std::size_t>(is_seen[i]);
    }
    if (held_count_ < kBlock) return;
    nearest_by_direction(held_, kBlock, nearest_);
    held_count_ -= kBlock;
    std::copy_n(held_ + 3 * kBlock, 3 * held_count_, held_);
  }
};

}  // namespace firstfix
