// Flat patches of a scan, with their normals: what a robot levels its scan by. Defined to the last bit
// (clients/protocol/on-the-robot.md, section 5).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
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
  constexpr std::size_t kInStep = 8;
  constexpr auto kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> patch(count, kNone);  // that each of the means is in
  std::vector<detail::Matrix3> scatters;
  detail::each_voxel(means, count, side_m, 0.0, detail::kZYX, [&](const auto* first, const auto* last) {
    if (last - first < kLeastPoints) return;
    detail::Vector3 centre{};
    for (const auto* entry = first; entry != last; ++entry) {
      for (std::size_t axis = 0; axis < 3; ++axis) centre[axis] += means[3 * std::size_t{entry->row} + axis];
      patch[entry->row] = static_cast<std::uint32_t>(scatters.size());
    }
    for (double& v : centre) v /= static_cast<double>(last - first);
    double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
    for (const auto* entry = first; entry != last; ++entry) {
      const double* mean = means + 3 * std::size_t{entry->row};
      const double x = mean[0] - centre[0], y = mean[1] - centre[1], z = mean[2] - centre[2];
      xx += x * x, xy += x * y, xz += x * z, yy += y * y, yz += y * z, zz += z * z;
    }
    scatters.push_back({{{xx, xy, xz}, {xy, yy, yz}, {xz, yz, zz}}});
  });
  const std::size_t patches = scatters.size();
  scatters.resize((patches + kInStep - 1) / kInStep * kInStep);
  std::vector<detail::SmallestEigenvector> smallest;
  smallest.reserve(scatters.size());
  for (std::size_t start = 0; start < scatters.size(); start += kInStep) {
    std::array<detail::Matrix3, kInStep> some;
    std::copy_n(scatters.data() + start, kInStep, some.begin());
    for (const detail::SmallestEigenvector& one : detail::smallest_eigenvectors(some)) smallest.push_back(one);
  }
  Patches flat;
  flat.points.reserve(3 * count);
  flat.normals.reserve(3 * count);
  for (std::size_t i = 0; i < count; ++i) {
    if (patch[i] == kNone) continue;
    const auto& [values, vector] = smallest[patch[i]];
    if (!(values[1] > kFlat * values[0])) continue;
    flat.points.insert(flat.points.end(), means + 3 * i, means + 3 * i + 3);
    flat.normals.insert(flat.normals.end(), vector.begin(), vector.end());
  }
  return flat;
}

}  // namespace firstfix
