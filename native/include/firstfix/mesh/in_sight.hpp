// Which points of a cloud a scanner at a place sees: no occupied voxel lies near them on the way to it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace firstfix {

// Voxels (size[0], size[1], size[2]) with corners at multiples of voxel_m, the first of them number low.
struct OccupiedVoxels {
  const std::uint8_t* occupied;
  std::int64_t size[3], low[3];
  double voxel_m;

  // Outside, none is occupied.
  bool at(const double* point) const {
    std::int64_t flat = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double voxel = std::floor(point[axis] / voxel_m);
      const double first = static_cast<double>(low[axis]);
      if (!(voxel >= first && voxel < first + static_cast<double>(size[axis]))) return false;
      flat = flat * size[axis] + (static_cast<std::int64_t>(voxel) - low[axis]);
    }
    return occupied[flat] != 0;
  }
};

// seen[i]: nothing hides points[i] from places[i] in the first `steps` voxels of its way, which begins start_voxels
// along outwards[i]. All are (count, 3).
inline void in_sight(const OccupiedVoxels& voxels, const double* points, const double* outwards, const double* places,
                     std::size_t count, double start_voxels, std::size_t steps, std::uint8_t* seen) {
  const double start_m = start_voxels * voxels.voxel_m;
  for (std::size_t i = 0; i < count; ++i) {
    double start[3], ray[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      start[axis] = points[3 * i + axis] + outwards[3 * i + axis] * start_m;
      ray[axis] = places[3 * i + axis] - start[axis];
    }
    const double length = std::sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
    for (double& along : ray) along /= std::max(length, 1e-9);
    bool is_clear = true;
    for (std::size_t step = 0; is_clear && step < steps; ++step) {
      const double distance = static_cast<double>(step) * voxels.voxel_m;
      if (!(distance < length - voxels.voxel_m)) break;
      double at[3];
      for (std::size_t axis = 0; axis < 3; ++axis) at[axis] = start[axis] + ray[axis] * distance;
      is_clear = !voxels.at(at);
    }
    seen[i] = is_clear;
  }
}

}  // namespace firstfix
