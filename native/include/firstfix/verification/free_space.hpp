// Free-space check: do rays of the scan pass through surfaces of the map?
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/scan/range_view.hpp"
#include "firstfix/verification/map_view.hpp"
#include "firstfix/verification/point_tiles.hpp"

namespace firstfix {

constexpr double kNearM = 9.0;                             // up to which the fine points are drawn, too
constexpr float kToleranceM = 0.3F, kTolerance = 0.03F;  // a return beyond a surface is further by this and this share

// Share of the directions with a return and a mapped surface in which the scan's nearest return, in and around the
// direction, lies beyond the surface; 1 if there is no such direction.
//
// returned, least: (directions,) of the scan.
inline double free_space_violation(const PointTiles& near, const PointTiles& far, double reach_m,
                                   const std::uint8_t* returned, const float* least, const double* T_map_sensor) {
  std::vector<float> mapped(kDirections, std::numeric_limits<float>::infinity());
  MapView view(T_map_sensor, RowBand::of(returned), mapped.data());
  view.draw(near, std::min(kNearM, reach_m));
  view.draw(far, reach_m);
  std::int32_t both = 0, beyond = 0;
  for (std::size_t i = 0; i < kDirections; ++i) {
    const bool is_common = (mapped[i] < std::numeric_limits<float>::infinity()) & (returned[i] != 0);
    both += is_common;
    beyond += is_common & (least[i] > mapped[i] * (1 + kTolerance) + kToleranceM);
  }
  return both == 0 ? 1.0 : static_cast<double>(beyond) / both;
}

}  // namespace firstfix
