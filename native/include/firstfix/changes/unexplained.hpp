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

// Sets, for each of (count,) returns, whether nothing is mapped near it, though the map covers the place: something is
// mapped behind it, or where nothing is mapped in its direction, below it.
//
// mapped: around the sensor, x y z x y z as the returns. T_map_sensor: (4, 4) in the frame of the grids. around, below:
// offsets, x y z x y z, of the places to look at.
inline void unexplained(const float* returns, std::size_t count, const std::vector<float>& mapped, const SurfaceGrid& fine,
                        const SurfaceGrid& coarse, const double* T_map_sensor, const std::vector<float>& around,
                        const std::vector<float>& below, float reach_m, std::uint8_t* is_new) {
  float R[9], t[3];
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) R[3 * row + column] = static_cast<float>(T_map_sensor[4 * row + column]);
    t[row] = static_cast<float>(T_map_sensor[4 * row + 3]);
  }
  const auto finds = [](const SurfaceGrid& grid, const float* where, const std::vector<float>& offsets) {
    for (std::size_t k = 0; k < offsets.size(); k += 3) {
      const float place[3] = {where[0] + offsets[k], where[1] + offsets[k + 1], where[2] + offsets[k + 2]};
      if (has_surface(grid, place)) return true;
    }
    return false;
  };
  const RangeImage behind(mapped.data(), mapped.size() / 3, kCoarseColumns);
  for (std::size_t i = 0; i < count; ++i) {
    const float x = returns[3 * i], y = returns[3 * i + 1], z = returns[3 * i + 2];
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
