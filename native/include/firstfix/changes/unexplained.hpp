// Which returns of a scan does the map not explain?
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/changes/compared.hpp"
#include "firstfix/changes/range_image.hpp"
#include "firstfix/registration/surface_grid.hpp"

namespace firstfix {

// Whether the grid finds a surface near a position of the index's frame.
inline bool has_surface(const SurfaceGrid& grid, const float* position_m) {
  const float per_m = 1 / grid.cell_m;
  std::int32_t cell[3], row = 0;
  for (int axis = 0; axis < 3; ++axis) {
    cell[axis] = cell_at((position_m[axis] - grid.corner_m[axis]) * per_m, grid.last(axis));
  }
  grid.nearest(&cell[0], &cell[1], &cell[2], 1, &row);
  return row >= 0;
}

// Sets, for each of the returns, whether nothing is mapped near it, though the map covers the place: something is
// mapped behind it, or where nothing is mapped in its direction, below it.
//
// mapped: around the sensor, as the returns. T_map_sensor: in the frame of the grids. around, below: offsets of the places
// to look at.
inline void unexplained(Vectors<const float> returns, Vectors<const float> mapped, const SurfaceGrid& fine,
                        const SurfaceGrid& coarse, const PoseMatrix& T_map_sensor, Vectors<const float> around,
                        Vectors<const float> below, float reach_m, std::uint8_t* is_new) {
  const auto [R, t] = FloatPose(T_map_sensor);
  const auto finds = [](const SurfaceGrid& grid, const float* where, Vectors<const float> offsets) {
    for (std::size_t k = 0; k < offsets.size; ++k) {
      const float* offset = offsets[k];
      const float place[3] = {where[0] + offset[0], where[1] + offset[1], where[2] + offset[2]};
      if (has_surface(grid, place)) return true;
    }
    return false;
  };
  const RangeImage behind(mapped, kCoarseColumns);
  for (std::size_t i = 0; i < returns.size; ++i) {
    const float x = returns[i][0], y = returns[i][1], z = returns[i][2];
    const float range_m = std::sqrt(x * x + y * y + z * z);
    const std::int32_t at = behind.at(x, y, z);
    const bool is_mapped = std::isfinite(behind.nearest_m[at]);
    // where a direction passes between two points of a wall, those around it tell what is mapped
    const bool is_known = is_mapped || std::isinf(behind.least_m[at]);
    is_new[i] = 0;
    if (!(range_m < reach_m && behind.nearest_m[at] > range_m && is_known)) continue;
    float where[3];
    for (int axis = 0; axis < 3; ++axis) {
      where[axis] = (R[3 * axis] * x + R[3 * axis + 1] * y + R[3 * axis + 2] * z) + t[axis];
    }
    if (!finds(fine, where, around)) is_new[i] = is_mapped || finds(coarse, where, below);
  }
}

}  // namespace firstfix
