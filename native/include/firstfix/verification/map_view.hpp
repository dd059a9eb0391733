// The map as it is seen from a pose: the nearest surface in each direction, by a z-buffer of the map's points.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/lanes.hpp"
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
    const Float8 reach2 = all8(static_cast<float>(reach_m * reach_m));
    tiles.each_run(centre_m_, reach_m, [&](std::int64_t first, std::int64_t end) {
      constexpr std::int64_t kStep = kLanes;
      for (; end - first >= kStep; first += kStep) take(tiles.points + 3 * first, reach2);
      if (first == end) return;
      float last[3 * kLanes];
      std::fill_n(last, 3 * kLanes, std::numeric_limits<float>::infinity());  // beyond any reach
      std::copy(tiles.points + 3 * first, tiles.points + 3 * end, last);
      take(last, reach2);
    });
    draw_held();
  }

 private:
  static constexpr std::size_t kHeld = detail::kDrawnAtOnce;
  static constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

  struct Cone {  // points at slope * distance across + offset
    float slope, offset;
    Float8 at(const Float8& across) const { return slope * across + offset; }
  };

  float* nearest_;
  FloatPose pose_;
  double centre_m_[3];
  Cone bottom_{0, -1e30F}, top_{0, 1e30F};
  float x_[kHeld], y_[kHeld], z_[kHeld], across_[kHeld];  // of points that wait to be drawn
  std::size_t held_ = 0;

  // Holds eight points, if one of them lies within reach and in the band. The others among them get no height, and so no range.
  void take(const float* points, const Float8& reach2) {
    const auto& [R, centre] = pose_;
    Float8 dx, dy, dz;
    split8(points, dx, dy, dz);
    dx -= centre[0], dy -= centre[1], dz -= centre[2];
    const Int8 is_near = dx * dx + dy * dy + dz * dz < reach2;
    if (!any(is_near)) return;
    const Float8 x = dx * R[0] + dy * R[3] + dz * R[6];
    const Float8 y = dx * R[1] + dy * R[4] + dz * R[7];
    const Float8 z = dx * R[2] + dy * R[5] + dz * R[8];
    const Float8 across = root_of(x * x + y * y);
    const Int8 is_seen = is_near & (z >= bottom_.at(across)) & (z <= top_.at(across));
    store8(x, x_ + held_), store8(y, y_ + held_), store8(is_seen ? z : all8(kNone), z_ + held_), store8(across, across_ + held_);
    held_ += any(is_seen) ? kLanes : 0;  // else the next eight take their place: a branch would often be foreseen wrongly
    if (held_ == kHeld) draw_held();
  }

  void draw_held() {
    detail::draw_points(x_, y_, z_, across_, held_, nearest_);
    held_ = 0;
  }
};

}  // namespace firstfix
