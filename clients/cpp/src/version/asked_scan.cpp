#include "asked_scan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <variant>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/level_hypotheses.hpp"
#include "firstfix/scan/deskew.hpp"
#include "firstfix/scan/timed_view.hpp"
#include "firstfix/verification/free_space.hpp"
#include "poses.hpp"

namespace firstfix::version {
namespace {

Vector6 motion_of(const Twist& twist) {
  Vector6 motion;
  for (std::size_t k = 0; k < 3; ++k) {
    motion[k] = twist.linear[k], motion[3 + k] = twist.angular[k];
  }
  return motion;
}

// Up in the sensor frame: the opposite of gravity, or where it is expected.
Levelling levelling_of(const PlacesOptions& options, double default_height_m) {
  if (options.gravity) {
    const detail::Vector3& down = *options.gravity;
    return {{-down[0], -down[1], -down[2]}, true, std::nullopt, default_height_m};
  }
  return {up_by_mounting(options.T_base_sensor), false, std::nullopt, default_height_m};
}

bool has_times(const AskedScan& scan) { return scan.whole != nullptr ? scan.whole->time_s.has_value() : scan.compact->time_s.has_value(); }

void check_times(const float* time_s, std::size_t count) {
  for (std::size_t i = 0; time_s != nullptr && i < count; ++i) {
    if (!(std::fabs(static_cast<double>(time_s[i])) <= kMaxAbsTime)) throw Error("invalid_scan", "a time is over 1 s from the stamp, or not a number");
  }
}

void check(const CompactScan& scan) {
  const auto require = [](bool holds, const char* message) {
    if (!holds) throw Error("invalid_scan", message);
  };
  if (scan.points.size() > kMaxCompactPoints) throw Error("too_large", "the compact scan has over 10,000 points");
  const auto is_near = [](const Point& p) {  // decoded coordinates may be a little over the limit
    const auto within = [](float v) { return std::fabs(static_cast<double>(v)) <= kMaxAbsCoordinate * 1.001; };
    return within(p.x) && within(p.y) && within(p.z);
  };
  require(std::all_of(scan.points.begin(), scan.points.end(), is_near), "a coordinate is not finite, or beyond 1000 m");
  require(scan.nearest_m.size() == kDirections, "a compact scan must have 16,200 ranges");
  require(std::all_of(scan.nearest_m.begin(), scan.nearest_m.end(), [](float range) { return range >= 0; }), "a range is NaN or below 0");
  require(!scan.time_s || scan.time_s->size() == scan.points.size(), "the number of times is not the number of points");
  if (!scan.described) return;
  const ScanDescriptor& described = *scan.described;
  require(detail::usable(described.descriptor) && described.occupancy.size() == described.descriptor.bytes(),
          "the descriptor does not have the size of its grid");
  require(std::fabs(detail::dot(described.up, described.up) - 1) < 2e-3 && std::fabs(described.height_m) <= 100,
          "up or the height of the descriptor is out of range");
}

// Whether a robot describes scans as a map does, with lengths as float32, as sent.
bool agrees(const ScanDescriptor& described, const LayeredGrid& grid) {
  const LayeredOccupancy& own = described.descriptor;
  if (own.rings != grid.rings || own.sectors != grid.sectors || own.layer_edges_m.size() != grid.edges_m.size()) return false;
  bool is_same = !(static_cast<float>(own.max_range_m) < grid.end_m || static_cast<float>(own.max_range_m) > grid.end_m);
  for (std::size_t i = 0; i < grid.edges_m.size(); ++i) {
    const auto edge_m = static_cast<float>(own.layer_edges_m[i]);
    is_same = is_same && !(edge_m < grid.edges_m[i] || edge_m > grid.edges_m[i]);
  }
  return is_same;
}

std::optional<PreparedScan> prepared_whole(const Scan& scan, bool is_in_time, const PlacesOptions& options,
                                           const EngineNumbers& numbers, const std::optional<Vector6>& motion) {
  if (scan.points.size() > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
  const Scan usable = cleaned(scan);
  const std::size_t count = usable.points.size();
  const float* points = numbers_of(usable.points);
  const float* time_s = usable.time_s ? usable.time_s->data() : nullptr;
  check_times(time_s, count);
  if (!is_in_time) time_s = nullptr;
  std::vector<float> at_stamp;
  if (motion) {
    at_stamp.resize(3 * count);
    deskew({points, count}, time_s, *motion, at_stamp.data());
    points = at_stamp.data(), time_s = nullptr;
  }
  return prepared_scan(points, time_s, count, numbers.preparation, levelling_of(options, numbers.default_height_m));
}

// As firstfix.engine.preprocess does it.
std::optional<PreparedScan> prepared_compact(const CompactScan& scan, bool is_in_time, const PlacesOptions& options,
                                             const EngineNumbers& numbers, const std::optional<Vector6>& motion) {
  check(scan);
  const std::size_t count = scan.points.size();
  const float* points = numbers_of(scan.points);
  const float* time_s = scan.time_s ? scan.time_s->data() : nullptr;
  check_times(time_s, count);
  if (!is_in_time) time_s = nullptr;
  const float* directions = detail::view_directions().data();
  std::vector<float> at_stamp, nearest_m = scan.nearest_m;
  if (motion) {
    const PointsInTime returns = timed_view(points, time_s, count, nearest_m.data(), directions);
    std::vector<float> moved(returns.points.size());
    deskew({returns.points.data(), returns.size()}, returns.times(), *motion, moved.data());
    nearest_m.assign(kDirections, std::numeric_limits<float>::infinity());
    nearest_by_direction(moved.data(), returns.size(), nearest_m.data());
    at_stamp.resize(3 * count);
    deskew({points, count}, time_s, *motion, at_stamp.data());
    points = at_stamp.data(), time_s = nullptr;
  }
  Levelling levelling = levelling_of(options, numbers.default_height_m);
  if (scan.described) levelling = {scan.described->up, true, scan.described->height_m, numbers.default_height_m};
  const Preparation& wanted = numbers.preparation;
  auto made = prepared_compact_scan(points, time_s, count, nearest_m.data(), directions, wanted, levelling);
  if (made && made->dense.at.times() != nullptr) {
    const auto least = static_cast<float>(wanted.min_range_m), most = static_cast<float>(wanted.max_range_m);
    for (float& range_m : nearest_m) {
      if (!(range_m > least && range_m < most)) range_m = std::numeric_limits<float>::infinity();
    }
    const PointsInTime near = PointsInTime::within_range(points, time_s, count, wanted.min_range_m, wanted.max_range_m);
    made->viewed = timed_view(near.points.data(), near.times(), near.size(), nearest_m.data(), directions);
  }
  return made;
}

}  // namespace

detail::Vector3 up_by_mounting(const std::optional<Pose>& T_base_sensor) {
  if (!T_base_sensor) return {0, 0, 1};
  const auto [x, y, z, w] = detail::normalised(*T_base_sensor).quaternion;
  return {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
}

QueriedScan queried(const PlacedScan& scan) {
  const PreparedScan& prepared = scan.prepared;
  const ScannedSurface& dense = prepared.dense;
  const ScanToLevel measured{scan.T_last_scan, prepared.R_level_sensor, {dense.at.points.data(), dense.normals.data(), dense.size()}};
  const std::uint8_t* occupancy = scan.described != nullptr ? scan.described->occupancy.data() : nullptr;
  return {measured, prepared.height_m, {prepared.seen.data(), prepared.seen.size() / 3}, occupancy};
}

std::optional<PriorRegion> region_of(const std::optional<Prior>& prior, const PoseMatrix& T_map_level) {
  if (!prior) return std::nullopt;
  return PriorRegion{T_map_level, prior->position, prior->radius_m, prior->yaw_deg, prior->yaw_range_deg};
}

AskedScans asked(const Scan& scan) { return {{&scan, nullptr, kSameFrame}}; }

AskedScans asked(const CompactScan& scan) { return {{nullptr, &scan, kSameFrame}}; }

AskedScans asked(const ScanSequence& sequence) {
  detail::check(sequence);
  const PoseMatrix T_last_odom = inverse(matrix_of(sequence.T_odom_sensor.back()));
  AskedScans scans;
  for (std::size_t i = 0; i < sequence.scans.size(); ++i) {
    scans.push_back({std::get_if<Scan>(&sequence.scans[i]), std::get_if<CompactScan>(&sequence.scans[i]),
                     product(T_last_odom, matrix_of(sequence.T_odom_sensor[i]))});
  }
  return scans;
}

std::vector<PlacedScan> prepared(const AskedScans& scans, const PlacesOptions& options, const EngineNumbers& numbers,
                                 const std::optional<Twist>& twist) {
  if (twist && !has_times(scans.back())) throw Error("invalid_option", "a twist needs the times of the scan's points");
  std::vector<PlacedScan> made;
  for (const AskedScan& one : scans) {
    // The motion that is solved, or known, is the last scan's.
    const bool is_last = &one == &scans.back();
    const std::optional<Vector6> motion = is_last && twist ? std::optional(motion_of(*twist)) : std::nullopt;
    PlacesOptions own = options;
    if (options.gravity) own.gravity = detail::in_scan(one.T_last_scan, *options.gravity);
    auto done = one.whole != nullptr ? prepared_whole(*one.whole, is_last, own, numbers, motion)
                                     : prepared_compact(*one.compact, is_last, own, numbers, motion);
    if (!done) continue;
    const bool is_described = one.compact != nullptr && one.compact->described && agrees(*one.compact->described, numbers.grid);
    made.push_back({one.T_last_scan, std::move(*done), is_described ? &*one.compact->described : nullptr});
  }
  return made;
}

}  // namespace firstfix::version
