#include "sent_query.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
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

void check_times(const std::optional<std::vector<float>>& time_s) {
  const auto is_near = [](float one_s) { return std::fabs(static_cast<double>(one_s)) <= kMaxAbsTime; };
  if (time_s && !std::all_of(time_s->begin(), time_s->end(), is_near)) {
    throw Error("invalid_scan", "a time is over 1 s from the stamp, or not a number");
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
  check_times(scan.time_s);
  if (!scan.described) return;
  const ScanDescriptor& described = *scan.described;
  require(detail::usable(described.descriptor) && described.occupancy.size() == described.descriptor.bytes(),
          "the descriptor does not have the size of its grid");
  require(std::fabs(detail::dot(described.up, described.up) - 1) < 2e-3 && std::fabs(described.height_m) <= 100,
          "up or the height of the descriptor is out of range");
}

Scan checked(const Scan& scan) {
  if (scan.points.size() > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
  Scan usable = cleaned(scan);
  check_times(usable.time_s);
  return usable;
}

// Null: they are not known. Those of no points are.
const float* times_in(const std::optional<std::vector<float>>& time_s) {
  static constexpr float kNone[1] = {};
  if (!time_s) return nullptr;
  return time_s->empty() ? kNone : time_s->data();
}

RobotDescription description_of(const ScanDescriptor& given) {
  const LayeredOccupancy& own = given.descriptor;
  std::vector<float> edges_m;
  for (const double edge_m : own.layer_edges_m) edges_m.push_back(static_cast<float>(edge_m));
  return {LayeredGrid::of(own.rings, own.sectors, own.max_range_m, std::move(edges_m)), given.occupancy, given.up, given.height_m};
}

detail::Vector3 up_by_mounting(const std::optional<Pose>& T_base_sensor) {
  if (!T_base_sensor) return {0, 0, 1};
  const auto [x, y, z, w] = detail::normalised(*T_base_sensor).quaternion;
  return {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
}

}  // namespace

std::optional<PriorRegion> region_of(const std::optional<Prior>& prior, const PoseMatrix& T_map_level) {
  if (!prior) return std::nullopt;
  return PriorRegion{T_map_level, prior->position, prior->radius_m, prior->yaw_deg, prior->yaw_range_deg};
}

SentScans sent(const Scan& scan) { return {{&scan, nullptr, kSameFrame}}; }

SentScans sent(const CompactScan& scan) { return {{nullptr, &scan, kSameFrame}}; }

SentScans sent(const ScanSequence& sequence) {
  detail::check(sequence);
  const PoseMatrix T_last_odom = inverse(matrix_of(sequence.T_odom_sensor.back()));
  SentScans scans;
  for (std::size_t i = 0; i < sequence.scans.size(); ++i) {
    scans.push_back({std::get_if<Scan>(&sequence.scans[i]), std::get_if<CompactScan>(&sequence.scans[i]),
                     product(T_last_odom, matrix_of(sequence.T_odom_sensor[i]))});
  }
  return scans;
}

std::optional<PreparedQuery> prepared(const SentScans& scans, const PlacesOptions& options, const EngineNumbers& numbers,
                                      const std::optional<Twist>& twist) {
  SensorState sensor{options.gravity, up_by_mounting(options.T_base_sensor), std::nullopt};
  if (twist) sensor.twist = motion_of(*twist);
  std::vector<Scan> usable;
  usable.reserve(scans.size());  // what is asked refers to them
  std::vector<AskedScan> asked;
  for (const SentScan& one : scans) {
    if (one.whole != nullptr) {
      const Scan& scan = usable.emplace_back(checked(*one.whole));
      asked.push_back({one.T_last_scan, {numbers_of(scan.points), scan.points.size()}, times_in(scan.time_s), nullptr, std::nullopt});
    } else {
      const CompactScan& scan = *one.compact;
      check(scan);
      std::optional<RobotDescription> described;
      if (scan.described) described = description_of(*scan.described);
      asked.push_back({one.T_last_scan, {numbers_of(scan.points), scan.points.size()}, times_in(scan.time_s), scan.nearest_m.data(),
                       std::move(described)});
    }
  }
  return PreparedQuery::of(asked, sensor, {numbers.preparation, numbers.default_height_m, numbers.spots_apart_m});
}

}  // namespace firstfix::version
