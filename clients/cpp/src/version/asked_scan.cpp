#include "asked_scan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/prepared_query.hpp"
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

// usable: of the scan, to which the result refers.
firstfix::AskedScan checked_whole(const Scan& usable, const PoseMatrix& T_last_scan) {
  const std::size_t count = usable.points.size();
  const float* time_s = usable.time_s ? usable.time_s->data() : nullptr;
  check_times(time_s, count);
  return {T_last_scan, {numbers_of(usable.points), count}, time_s, nullptr, std::nullopt};
}

RobotDescription description_of(const ScanDescriptor& given) {
  const LayeredOccupancy& own = given.descriptor;
  std::vector<float> edges_m;
  for (const double edge_m : own.layer_edges_m) edges_m.push_back(static_cast<float>(edge_m));
  return {LayeredGrid::of(own.rings, own.sectors, own.max_range_m, std::move(edges_m)), given.occupancy, given.up, given.height_m};
}

firstfix::AskedScan checked_compact(const CompactScan& scan, const PoseMatrix& T_last_scan) {
  check(scan);
  const std::size_t count = scan.points.size();
  const float* time_s = scan.time_s ? scan.time_s->data() : nullptr;
  check_times(time_s, count);
  std::optional<RobotDescription> described;
  if (scan.described) described = description_of(*scan.described);
  return {T_last_scan, {numbers_of(scan.points), count}, time_s, scan.nearest_m.data(), std::move(described)};
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
  SensorState sensor{options.gravity, up_by_mounting(options.T_base_sensor), std::nullopt};
  if (twist) sensor.twist = motion_of(*twist);
  const QueryNumbers wanted{numbers.preparation, numbers.default_height_m, numbers.spots_apart_m};
  std::vector<PlacedScan> made;
  for (const AskedScan& one : scans) {
    Scan usable;
    firstfix::AskedScan asked{one.T_last_scan, {nullptr, 0}, nullptr, nullptr, std::nullopt};
    if (one.whole != nullptr) {
      if (one.whole->points.size() > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
      usable = cleaned(*one.whole);
      asked = checked_whole(usable, one.T_last_scan);
    } else {
      asked = checked_compact(*one.compact, one.T_last_scan);
    }
    auto done = detail::prepared(asked, &one == &scans.back(), sensor, wanted);
    if (!done) continue;
    const bool is_described = asked.described && asked.described->agrees_with(numbers.grid);
    made.push_back({one.T_last_scan, std::move(*done), is_described ? &*one.compact->described : nullptr});
  }
  return made;
}

}  // namespace firstfix::version
