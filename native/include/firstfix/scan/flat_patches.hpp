// Flat patches of a scan, with their normals: what a robot levels its scan by. Defined to the last bit
// (clients/protocol/on-the-robot.md, section 5).
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "firstfix/bit_exact/eigh3.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/voxel_order.hpp"

namespace firstfix {

// Points on flat surfaces, with the surface normals. Both x y z x y z.
struct Patches {
  std::vector<double> points, normals;
};

// Voxel means that lie in one plane with the others in their cube. `side_m` is the cube's edge. Throws as voxel_box
// does.
inline Patches flat_patches(const double* means, std::size_t count, double side_m) {
  constexpr std::ptrdiff_t kLeastPoints = 4;
  constexpr double kFlat = 100.0;  // variance along a patch over that across it, at least
  std::vector<char> known(count);
  std::vector<detail::Vector3> normal(count);
  std::size_t found = 0;
  detail::each_voxel(means, count, side_m, 0.0, detail::kZYX, [&](const auto* first, const auto* last) {
    if (last - first < kLeastPoints) return;
    detail::Vector3 centre{};
    for (const auto* entry = first; entry != last; ++entry) {
      for (std::size_t axis = 0; axis < 3; ++axis) centre[axis] += means[3 * std::size_t{entry->row} + axis];
    }
    for (double& v : centre) v /= static_cast<double>(last - first);
    detail::Matrix3 scatter{};
    for (const auto* entry = first; entry != last; ++entry) {
      const double* mean = means + 3 * std::size_t{entry->row};
      const detail::Vector3 off{mean[0] - centre[0], mean[1] - centre[1], mean[2] - centre[2]};
      for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t b = 0; b < 3; ++b) scatter[a][b] += off[std::min(a, b)] * off[std::max(a, b)];
      }
    }
    const detail::SmallestEigenvector smallest = detail::smallest_eigenvector(scatter);
    if (!(smallest.values[1] > kFlat * smallest.values[0])) return;
    for (const auto* entry = first; entry != last; ++entry) {
      known[entry->row] = 1;
      normal[entry->row] = smallest.vector;
      ++found;
    }
  });
  Patches flat;
  flat.points.reserve(3 * found);
  flat.normals.reserve(3 * found);
  for (std::size_t i = 0; i < count; ++i) {
    if (known[i] == 0) continue;
    flat.points.insert(flat.points.end(), means + 3 * i, means + 3 * i + 3);
    flat.normals.insert(flat.normals.end(), normal[i].begin(), normal[i].end());
  }
  return flat;
}

}  // namespace firstfix
