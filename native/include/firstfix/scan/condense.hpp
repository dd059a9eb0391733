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
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/descriptor_parameters.hpp"
#include "firstfix/scan/flat_patches.hpp"
#include "firstfix/scan/levelling.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/timed_points.hpp"
#include "firstfix/scan/up_vote.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix {

using Gravity = std::array<double, 3>;  // points down, in the sensor frame; any length but zero

namespace detail {

// The unit vector that points up.
inline Vector3 up_of(const Gravity& gravity) {
  const double length = std::sqrt(dot(gravity, gravity));
  if (!(length >= 1e-6 && length <= 1e9)) throw Error("invalid_option", "gravity has no direction");
  return {-gravity[0] / length, -gravity[1] / length, -gravity[2] / length};
}

inline ScanDescriptor described(const std::vector<Point>& near, const std::vector<Vector3>& means,
                                const DescriptorParameters& parameters, const std::optional<Gravity>& gravity) {
  Patches flat = flat_patches(numbers_of(means), means.size(), 3.0 * parameters.voxel_m);
  const std::size_t count = flat.points.size() / 3;
  ScanDescriptor made{*parameters.descriptor, {}, gravity ? up_of(*gravity) : estimate_up(flat.normals.data(), count), 0};
  // float, as it is sent, so that the result does not depend on the last digits
  for (double& v : made.up) v = static_cast<double>(static_cast<float>(v));
  const Matrix3 R = levelling_rotation(made.up);
  turned(flat.points.data(), count, R[0].data(), flat.points.data());
  turned(flat.normals.data(), count, R[0].data(), flat.normals.data());
  made.height_m = floor_height(flat.points.data(), flat.normals.data(), count).value_or(parameters.default_height_m);
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
  const detail::TimedPoints timed = detail::TimedPoints::within_range(scan, parameters.min_range_m, parameters.max_range_m);
  const auto& near = timed.points;
  const detail::TimedPoints some = timed.at_most(detail::kVoxelFilterPoints);
  const auto means = detail::voxel_means(some.points, parameters.voxel_m);
  const std::optional<std::vector<double>> times = some.voxel_mean_times(parameters.voxel_m);
  CompactScan compact;
  if (times) compact.time_s.emplace();
  for (const auto row : rows_by_voxel_hash(detail::numbers_of(means), means.size(), parameters.voxel_m, points)) {
    const auto& [x, y, z] = means[static_cast<std::size_t>(row)];
    compact.points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
    if (times) compact.time_s->push_back(static_cast<float>((*times)[static_cast<std::size_t>(row)]));
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
