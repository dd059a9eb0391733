// On the robot: from a scan to the few kilobytes that a query needs.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "compact_scan.hpp"
#include "levelling.hpp"
#include "query_parameters.hpp"
#include "scan.hpp"
#include "scan_view.hpp"
#include "symmetric.hpp"
#include "voxel_filter.hpp"

namespace firstfix {

using Gravity = std::array<double, 3>;  // direction in the sensor frame, downwards, of any length but zero

namespace detail {

struct Patches {
  std::vector<Vector3> points, normals;  // of flat surfaces
};

// Means in cubes of three voxels, where they lie in one plane.
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
    const SmallestAxis found = smallest_axis(scatter[k]);
    if (found.values[1] > 100.0 * found.values[0]) normal[k] = found.axis;
  }
  Patches flat;
  for (std::size_t i = 0; i < means.size(); ++i) {
    if (!normal[patch[i]]) continue;
    flat.points.push_back(means[i]);
    flat.normals.push_back(*normal[patch[i]]);
  }
  return flat;
}

// Which cells of the polar grid hold something: docs/method.md (3.1).
inline std::vector<std::uint8_t> occupancy(const std::vector<Point>& levelled, float height_m,
                                           const DescriptorParameters& grid) {
  const std::vector<float> edges(grid.layer_edges_m.begin(), grid.layer_edges_m.end());
  const auto end_m = static_cast<float>(grid.max_range_m);
  const auto rings_a_metre = static_cast<float>(static_cast<double>(grid.rings) / grid.max_range_m);
  const auto sectors = static_cast<std::ptrdiff_t>(grid.sectors);
  std::vector<std::uint8_t> bits(grid.bytes());
  for (const Point& p : levelled) {
    const auto edge = std::upper_bound(edges.begin(), edges.end(), p.z + height_m);
    if (edge == edges.begin() || edge == edges.end()) continue;
    const float radius = std::sqrt(p.x * p.x + p.y * p.y);
    if (!(radius < end_m)) continue;
    const auto layer = static_cast<std::size_t>(edge - edges.begin()) - 1;
    const std::size_t ring = std::min(static_cast<std::size_t>(radius * rings_a_metre), grid.rings - 1);
    auto sector = static_cast<std::ptrdiff_t>(std::floor(turns(p.y, p.x) * static_cast<float>(sectors)));
    sector = std::min(sector < 0 ? sector + sectors : sector, sectors - 1);
    const std::size_t bit = (layer * grid.rings + ring) * grid.sectors + static_cast<std::size_t>(sector);
    bits[bit / 8] = static_cast<std::uint8_t>(bits[bit / 8] | (0x80U >> (bit % 8)));
  }
  return bits;
}

inline Vector3 against(const Gravity& gravity) {
  const double length = std::sqrt(dot(gravity, gravity));
  if (!(length >= 1e-6 && length <= 1e9)) throw Error("invalid_option", "gravity has no direction");
  return {-gravity[0] / length, -gravity[1] / length, -gravity[2] / length};
}

inline ScanDescriptor described(const std::vector<Point>& near, const std::vector<Vector3>& means,
                                const QueryParameters& parameters, const std::optional<Gravity>& gravity) {
  Patches flat = patches(means, 3.0 * parameters.voxel_m);
  ScanDescriptor made{*parameters.descriptor, {}, gravity ? against(*gravity) : estimate_up(flat.normals), 0};
  // as it is sent: nothing depends on its last digits
  for (double& v : made.up) v = static_cast<double>(static_cast<float>(v));
  const Matrix3 R = levelling_rotation(made.up);
  for (Vector3& p : flat.points) p = turned(p, R);
  for (Vector3& n : flat.normals) n = turned(n, R);
  made.height_m = floor_height(flat.points, flat.normals).value_or(parameters.default_height_m);
  std::vector<Point> levelled(near.size());
  std::transform(near.begin(), near.end(), levelled.begin(), [&R](const Point& p) { return turned(p, R); });
  made.occupancy = occupancy(levelled, static_cast<float>(made.height_m), made.parameters);
  return made;
}

constexpr std::size_t kVoxelled = 40'000, kReturns = 20'000;

}  // namespace detail

// What a compact query holds of a scan: at most `points` of its voxel means, its view, and, where the parameters
// have a descriptor, that too. Throws "invalid_option".
inline CompactScan condense(const Scan& scan, const QueryParameters& parameters = {},
                            const std::optional<Gravity>& gravity = std::nullopt, std::size_t points = 2500) {
  detail::check(parameters);
  if (points < 1 || points > kMaxCompactPoints) {
    throw Error("invalid_option", "a compact query has 1 to 10000 points");
  }
  const auto near = detail::within_range(scan.points, parameters.min_range_m, parameters.max_range_m);
  const auto means = detail::voxel_means(detail::at_most(near, detail::kVoxelled), parameters.voxel_m);
  CompactScan compact;
  for (const auto& [x, y, z] : detail::at_most(means, points)) {
    compact.points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
  }
  compact.nearest_m = detail::nearest_by_direction(detail::at_most(near, detail::kReturns));
  if (parameters.descriptor) compact.described = detail::described(near, means, parameters, gravity);
  return compact;
}

// The descriptor alone, for candidates without registration. Throws "invalid_option".
inline ScanDescriptor describe(const Scan& scan, const QueryParameters& parameters,
                               const std::optional<Gravity>& gravity = std::nullopt) {
  detail::check(parameters);
  if (!parameters.descriptor) throw Error("invalid_option", "a descriptor needs the parameters of the map");
  const auto near = detail::within_range(scan.points, parameters.min_range_m, parameters.max_range_m);
  const auto means = detail::voxel_means(detail::at_most(near, detail::kVoxelled), parameters.voxel_m);
  return detail::described(near, means, parameters, gravity);
}

}  // namespace firstfix
