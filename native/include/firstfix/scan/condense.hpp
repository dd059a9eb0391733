// Reduces a scan to the few kilobytes that a query needs. Runs on the robot.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "firstfix/descriptor/layered_occupancy.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/descriptor_parameters.hpp"
#include "firstfix/scan/flat_patches.hpp"
#include "firstfix/scan/levelling.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/scan/returns.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/up_vote.hpp"
#include "firstfix/scan/voxel_filter.hpp"
#include "firstfix/scan/voxel_sums.hpp"

namespace firstfix {

using Gravity = std::array<double, 3>;  // points down, in the sensor frame; any length but zero

namespace detail {

// The unit vector that points up.
inline Vector3 up_of(const Gravity& gravity) {
  const double length = std::sqrt(dot(gravity, gravity));
  if (!(length >= 1e-6 && length <= 1e9)) throw Error("invalid_option", "gravity has no direction");
  return {-gravity[0] / length, -gravity[1] / length, -gravity[2] / length};
}

// A number rounded to float, so that the result does not depend on the last digits. GCC 12 leaves out such conversions of two
// numbers beside each other, but none by way of a volatile variable.
inline double as_sent(double number) {
  const volatile float sent = static_cast<float>(number);
  return static_cast<double>(sent);
}

inline ScanDescriptor described(const Returns& near, const VoxelMeans& means, const DescriptorParameters& parameters,
                                const std::optional<Gravity>& gravity) {
  Patches flat = flat_patches(means.points, means.count, 3.0 * parameters.voxel_m);
  const std::size_t count = flat.points.size() / 3;
  ScanDescriptor made{*parameters.descriptor, {}, gravity ? up_of(*gravity) : estimate_up(flat.normals.data(), count), 0};
  for (double& v : made.up) v = as_sent(v);
  const Matrix3 R = levelling_rotation(made.up);
  turned(flat.points.data(), count, R[0].data(), flat.points.data());
  turned(flat.normals.data(), count, R[0].data(), flat.normals.data());
  made.height_m = floor_height(flat.points.data(), flat.normals.data(), count).value_or(parameters.default_height_m);
  made.occupancy = occupancy(near.points, near.count, R, static_cast<float>(made.height_m), made.descriptor);
  return made;
}

constexpr std::size_t kVoxelFilterPoints = 40'000;
constexpr std::size_t kRangeViewPoints = 20'000;
constexpr std::size_t kKeptReturns = 500'000;  // of a larger scan the memory is given back: 6 MB and more

// A scan on its way to a query, in memory that each thread keeps.
class Reduction {
 public:
  // Calls use(reduction) with the returns of a scan that the parameters let through.
  template <class Use>
  static auto of(const Returns& returns, const DescriptorParameters& parameters, Use use) {
    check(parameters);
    thread_local Reduction kept;
    if (returns.count <= kKeptReturns) return use(kept.started(returns, parameters));
    Reduction own;
    return use(own.started(returns, parameters));
  }

  CompactScan compact(std::size_t most) {
    CompactScan made;
    if (means_.time_s != nullptr) made.time_s.emplace();
    for (const std::int64_t row : rows_by_voxel_hash(means_.points, means_.count, parameters_->voxel_m, most)) {
      const double* mean = means_.points + 3 * row;
      made.points.push_back({static_cast<float>(mean[0]), static_cast<float>(mean[1]), static_cast<float>(mean[2])});
      if (made.time_s) made.time_s->push_back(static_cast<float>(means_.time_s[row]));
    }
    const Returns seen = sample_.at_most(near_, kRangeViewPoints);
    made.nearest_m.assign(kDirections, std::numeric_limits<float>::infinity());
    nearest_by_direction(seen.points, seen.count, made.nearest_m.data());
    return made;
  }

  ScanDescriptor described(const std::optional<Gravity>& gravity) const {
    return detail::described(near_, means_, *parameters_, gravity);
  }

 private:
  Reduction& started(const Returns& returns, const DescriptorParameters& parameters) {
    parameters_ = &parameters;
    near_ = filter_.within_range(returns, parameters.min_range_m, parameters.max_range_m);
    means_ = sums_.means(sample_.at_most(near_, kVoxelFilterPoints), parameters.voxel_m);
    return *this;
  }

  const DescriptorParameters* parameters_ = nullptr;
  ReturnFilter filter_, sample_;
  VoxelSums sums_;
  Returns near_;
  VoxelMeans means_;
};

inline Returns returns_of(const Scan& scan) {
  if (scan.time_s && scan.time_s->size() != scan.points.size()) {
    throw Error("invalid_scan", "the number of times is not the number of points");
  }
  // without a point there is no memory, and no time is no absence of times
  static constexpr float kNone[3] = {};
  const float* time_s = !scan.time_s ? nullptr : scan.time_s->empty() ? kNone : scan.time_s->data();
  return {scan.points.empty() ? kNone : numbers_of(scan.points), time_s, scan.points.size()};
}

}  // namespace detail

// The content of a compact query: at most `points` of the scan's voxel means and its range view. If the parameters have
// a descriptor, the scan is described too. Throws "invalid_option".
inline CompactScan condense(const Returns& returns, const DescriptorParameters& parameters = {},
                            const std::optional<Gravity>& gravity = std::nullopt, std::size_t points = 2500) {
  if (points < 1 || points > kMaxCompactPoints) {
    throw Error("invalid_option", "a compact query has 1 to 10000 points");
  }
  return detail::Reduction::of(returns, parameters, [&](detail::Reduction& reduction) {
    CompactScan compact = reduction.compact(points);
    if (returns.time_s != nullptr && !compact.time_s) compact.time_s.emplace();
    if (parameters.descriptor) compact.described = reduction.described(gravity);
    return compact;
  });
}

// Throws "invalid_scan" too, for another number of times than of points.
inline CompactScan condense(const Scan& scan, const DescriptorParameters& parameters = {},
                            const std::optional<Gravity>& gravity = std::nullopt, std::size_t points = 2500) {
  return condense(detail::returns_of(scan), parameters, gravity, points);
}

// The descriptor alone. The service answers it with candidates and does not register. Throws "invalid_option".
inline ScanDescriptor describe(const Scan& scan, const DescriptorParameters& parameters,
                               const std::optional<Gravity>& gravity = std::nullopt) {
  if (!parameters.descriptor) throw Error("invalid_option", "a descriptor needs the descriptor parameters of the map");
  return detail::Reduction::of(detail::returns_of(scan), parameters,
                               [&](const detail::Reduction& reduction) { return reduction.described(gravity); });
}

}  // namespace firstfix
