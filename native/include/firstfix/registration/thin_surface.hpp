// Thins a surface to the mean point of every voxel, one for each main direction of its normals.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/voxel_order.hpp"

namespace firstfix {

// Points with unit normals, x y z x y z, and whether each normal is known to point to the viewer.
struct ThinnedSurface {
  std::vector<float> points, normals;
  std::vector<std::uint8_t> oriented;
};

// In the order of the voxels' x, then y, then z. Throws as voxel_box does.
inline ThinnedSurface thin_surface(Vectors<const float> points, Vectors<const float> normals, const std::uint8_t* oriented,
                                  double voxel_m) {
  struct Part {
    double count = 0, point[3] = {}, normal[3] = {};
  };
  constexpr std::size_t kWays = 9;  // axis of the normal; oriented forwards, backwards, or not
  ThinnedSurface thinned;
  detail::each_voxel(points.data, points.size, voxel_m, 0.0, detail::kXYZ, [&](const auto* first, const auto* last) {
    Part parts[kWays];
    for (const auto* entry = first; entry != last; ++entry) {
      const std::size_t row = entry->row;
      const float *point = points[row], *normal = normals[row];
      std::size_t main_axis = 0;
      for (std::size_t axis = 1; axis < 3; ++axis) {
        if (std::fabs(normal[axis]) > std::fabs(normal[main_axis])) main_axis = axis;
      }
      const bool sure = oriented[row] != 0, backwards = normal[main_axis] < 0;
      Part& part = parts[3 * (sure ? (backwards ? 2 : 0) : 1) + main_axis];
      const double turn = backwards && !sure ? -1 : 1;
      part.count += 1;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        part.point[axis] += static_cast<double>(point[axis]);
        part.normal[axis] += turn * static_cast<double>(normal[axis]);
      }
    }
    for (std::size_t way = 0; way < kWays; ++way) {
      const Part& part = parts[way];
      if (part.count == 0) continue;
      float mean[3];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        thinned.points.push_back(static_cast<float>(part.point[axis] / part.count));
        mean[axis] = static_cast<float>(part.normal[axis] / part.count);
      }
      const float length = std::sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
      for (const float along : mean) thinned.normals.push_back(along / (length > 1e-6F ? length : 1e-6F));
      thinned.oriented.push_back(way / 3 == 1 ? 0 : 1);
    }
  });
  return thinned;
}

}  // namespace firstfix
