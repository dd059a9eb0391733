// Free-space check: do rays of the scan pass through surfaces of the map?
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/registration/surface_grid.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/verification/map_view.hpp"
#include "firstfix/verification/point_tiles.hpp"

namespace firstfix {

constexpr double kNearM = 9.0;                             // up to which the fine points are drawn, too
constexpr float kToleranceM = 0.3F, kTolerance = 0.03F;  // a return beyond a surface is further by this and this share

// Shares of directions that pass through a surface of the map.
struct SeenThrough {
  double onto_nothing = 1, onto_surface = 0;
};

namespace detail {

// Unit vectors, x y z x y z, through the middles of the cells of a range view.
inline const std::vector<float>& view_directions() {
  static const std::vector<float> made = [] {
    constexpr double kCellRad = 2 * kPi / static_cast<double>(kViewColumns);
    std::vector<float> directions;
    for (std::size_t row = 0; row < kViewRows; ++row) {
      for (std::size_t column = 0; column < kViewColumns; ++column) {
        const double azimuth = (static_cast<double>(column) + 0.5) * kCellRad - kPi;
        const double elevation = (static_cast<double>(row) + 0.5) * kCellRad - kPi / 2;
        directions.push_back(static_cast<float>(std::cos(elevation) * std::cos(azimuth)));
        directions.push_back(static_cast<float>(std::cos(elevation) * std::sin(azimuth)));
        directions.push_back(static_cast<float>(std::sin(elevation)));
      }
    }
    return directions;
  }();
  return made;
}

}  // namespace detail

// Number of a scan's returns whose cell of the grid has a surface point. Returns outside of the grid have none.
//
// directions: (count,) of the returns. least: (directions,) of the scan.
inline std::size_t returns_near_surface(const SurfaceGrid& grid, const std::vector<std::int32_t>& directions,
                                        const float* least, const PoseMatrix& T_map_sensor) {
  const auto [R, from_corner] = FloatPose(T_map_sensor, grid.corner_m);
  const std::vector<float>& unit = detail::view_directions();
  std::vector<float> positions;
  for (const std::int32_t direction : directions) {
    const float* d = &unit[3 * static_cast<std::size_t>(direction)];
    for (int axis = 0; axis < 3; ++axis) {
      const float* r = R + 3 * axis;
      positions.push_back((r[0] * d[0] + r[1] * d[1] + r[2] * d[2]) * least[direction] + from_corner[axis]);
    }
  }
  return near_surface(grid, positions);
}

// Of the directions with a return and a mapped surface, the shares in which the scan's nearest return, in and around the
// direction, lies beyond the surface: where the map has nothing, or near another surface of it.
//
// surface: a grid of the same map. returned, least: (directions,) of the scan.
inline SeenThrough seen_through(const PointTiles& near, const PointTiles& far, double reach_m, const SurfaceGrid& surface,
                                const std::uint8_t* returned, const float* least, const PoseMatrix& T_map_sensor) {
  const RowBand band = RowBand::of(returned);
  std::vector<float> mapped(kDirections, std::numeric_limits<float>::infinity());
  MapView view(T_map_sensor, band, mapped.data());
  view.draw(near, std::min(kNearM, reach_m));
  view.draw(far, reach_m);
  std::int32_t both = 0;
  std::vector<std::int32_t> beyond(kDirections);
  std::size_t count = 0;
  const std::size_t end = static_cast<std::size_t>(band.highest + 1) * kViewColumns;  // no row above it has a return
  for (std::size_t i = static_cast<std::size_t>(band.lowest) * kViewColumns; i < end; ++i) {
    const bool is_common = (mapped[i] < std::numeric_limits<float>::infinity()) & (returned[i] != 0);
    both += is_common;
    beyond[count] = static_cast<std::int32_t>(i);
    count += is_common & (least[i] > mapped[i] * (1 + kTolerance) + kToleranceM);
  }
  if (both == 0) return {};
  beyond.resize(count);
  const std::size_t onto_surface = returns_near_surface(surface, beyond, least, T_map_sensor);
  return {static_cast<double>(count - onto_surface) / both, static_cast<double>(onto_surface) / both};
}

}  // namespace firstfix
