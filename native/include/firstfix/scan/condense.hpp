// Reduces a scan to the few kilobytes that a query needs. Runs on the robot.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "firstfix/descriptor/layered_occupancy.hpp"
#include "firstfix/portable/eigh3.hpp"
#include "firstfix/portable/vector3.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/descriptor_parameters.hpp"
#include "firstfix/scan/levelling.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix {

using Gravity = std::array<double, 3>;  // points down, in the sensor frame; any length but zero

namespace detail {

// Points on flat surfaces, with the surface normals.
struct Patches {
  std::vector<Vector3> points, normals;
};

// Voxel means that lie in one plane with the others in their cube. `side_m` is the cube's edge.
inline Patches patches(const std::vector<Vector3>& means, double side_m) {
  std::vector<Cell> cells(means.size());
  for (std::size_t i = 0; i < means.size(); ++i) cells[i] = cell_of(means[i], side_m);
  const CellBox box = CellBox::around(cells);
  std::vector<std::int64_t> numbers(means.size());
  for (std::size_t i = 0; i < means.size(); ++i) numbers[i] = box.number(cells[i]);
  std::vector<std::int64_t> known = numbers;
  std::sort(known.begin(), known.end());
  known.erase(std::unique(known.begin(), known.end()), known.end());
  std::vector<std::size_t> patch(means.size());
  std::vector<double> count(known.size());
  std::vector<Vector3> centre(known.size());
  for (std::size_t i = 0; i < means.size(); ++i) {
    patch[i] = static_cast<std::size_t>(std::lower_bound(known.begin(), known.end(), numbers[i]) - known.begin());
    count[patch[i]] += 1;
    for (std::size_t axis = 0; axis < 3; ++axis) centre[patch[i]][axis] += means[i][axis];
  }
  for (std::size_t k = 0; k < known.size(); ++k) {
    for (double& v : centre[k]) v /= count[k];
  }
  std::vector<Matrix3> scatter(known.size());
  for (std::size_t i = 0; i < means.size(); ++i) {
    const Vector3& c = centre[patch[i]];
    const Vector3 off{means[i][0] - c[0], means[i][1] - c[1], means[i][2] - c[2]};
    for (std::size_t a = 0; a < 3; ++a) {
      for (std::size_t b = 0; b < 3; ++b) scatter[patch[i]][a][b] += off[std::min(a, b)] * off[std::max(a, b)];
    }
  }
  std::vector<std::optional<Vector3>> normal(known.size());
  for (std::size_t k = 0; k < known.size(); ++k) {
    if (count[k] < 4) continue;
    const SmallestEigenvector found = smallest_eigenvector(scatter[k]);
    if (found.values[1] > 100.0 * found.values[0]) normal[k] = found.vector;
  }
  Patches flat;
  for (std::size_t i = 0; i < means.size(); ++i) {
    if (!normal[patch[i]]) continue;
    flat.points.push_back(means[i]);
    flat.normals.push_back(*normal[patch[i]]);
  }
  return flat;
}

// The unit vector that points up.
inline Vector3 up_of(const Gravity& gravity) {
  const double length = std::sqrt(dot(gravity, gravity));
  if (!(length >= 1e-6 && length <= 1e9)) throw Error("invalid_option", "gravity has no direction");
  return {-gravity[0] / length, -gravity[1] / length, -gravity[2] / length};
}

inline ScanDescriptor described(const std::vector<Point>& near, const std::vector<Vector3>& means,
                                const DescriptorParameters& parameters, const std::optional<Gravity>& gravity) {
  Patches flat = patches(means, 3.0 * parameters.voxel_m);
  ScanDescriptor made{*parameters.descriptor, {}, gravity ? up_of(*gravity) : estimate_up(flat.normals), 0};
  // float, as it is sent, so that the result does not depend on the last digits
  for (double& v : made.up) v = static_cast<double>(static_cast<float>(v));
  const Matrix3 R = levelling_rotation(made.up);
  for (Vector3& p : flat.points) p = rotated(p, R);
  for (Vector3& n : flat.normals) n = rotated(n, R);
  made.height_m = floor_height(flat.points, flat.normals).value_or(parameters.default_height_m);
  made.occupancy = occupancy(near, R, static_cast<float>(made.height_m), made.descriptor);
  return made;
}

constexpr std::size_t kVoxelFilterPoints = 40'000;
constexpr std::size_t kRangeViewPoints = 20'000;

}  // namespace detail

// The content of a compact query: at most `points` of the scan's voxel means and its range view. If the parameters have
// a descriptor, the scan is described too. Throws "invalid_option".
inline CompactScan condense(const Scan& scan, const DescriptorParameters& parameters = {},
                            const std::optional<Gravity>& gravity = std::nullopt, std::size_t points = 2500) {
  detail::check(parameters);
  if (points < 1 || points > kMaxCompactPoints) {
    throw Error("invalid_option", "a compact query has 1 to 10000 points");
  }
  const auto near = detail::within_range(scan.points, parameters.min_range_m, parameters.max_range_m);
  const auto means = detail::voxel_means(detail::at_most(near, detail::kVoxelFilterPoints), parameters.voxel_m);
  CompactScan compact;
  for (const auto& [x, y, z] : detail::at_most(means, points)) {
    compact.points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
  }
  compact.nearest_m = detail::nearest_by_direction(detail::at_most(near, detail::kRangeViewPoints));
  if (parameters.descriptor) compact.described = detail::described(near, means, parameters, gravity);
  return compact;
}

// The descriptor alone. The service answers it with candidates and does not register. Throws "invalid_option".
inline ScanDescriptor describe(const Scan& scan, const DescriptorParameters& parameters,
                               const std::optional<Gravity>& gravity = std::nullopt) {
  detail::check(parameters);
  if (!parameters.descriptor) throw Error("invalid_option", "a descriptor needs the descriptor parameters of the map");
  const auto near = detail::within_range(scan.points, parameters.min_range_m, parameters.max_range_m);
  const auto means = detail::voxel_means(detail::at_most(near, detail::kVoxelFilterPoints), parameters.voxel_m);
  return detail::described(near, means, parameters, gravity);
}

}  // namespace firstfix
