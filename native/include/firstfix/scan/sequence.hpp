// Several scans with the sensor's motion between them.
#pragma once

#include <cmath>
#include <cstddef>
#include <string>
#include <variant>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/pose.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix {

constexpr std::size_t kMaxScans = 16;
constexpr double kMaxWayM = 1000.0;    // of a scan from the last one
constexpr double kMaxOdometryM = 1e8;  // of a pose from its frame's origin: further away differences lose their millimetres

using AnyScan = std::variant<Scan, CompactScan>;

// Scans in the order in which they were taken. The answer is the pose of the last one.
struct ScanSequence {
  std::vector<AnyScan> scans;
  std::vector<Pose> T_odom_sensor;  // one per scan, all in the same fixed frame
};

namespace detail {

inline std::size_t points_of(const AnyScan& scan) {
  return std::visit([](const auto& one) { return one.points.size(); }, scan);
}

// Throws Error "invalid_scan" or "too_large" in the words of a service.
inline void check(const ScanSequence& sequence) {
  const std::size_t count = sequence.scans.size(), poses = sequence.T_odom_sensor.size();
  const auto refuse = [](const std::string& why) { throw Error("invalid_scan", why); };
  if (count == 0 || count != poses) {
    refuse("a sequence needs one pose for each scan: " + std::to_string(count) + " scans, " + std::to_string(poses) + " poses");
  }
  if (count > kMaxScans) throw Error("too_large", "a sequence holds up to 16 scans, not " + std::to_string(count));
  std::size_t points = 0;
  for (const AnyScan& scan : sequence.scans) points += points_of(scan);
  if (points > kMaxPoints) {
    throw Error("too_large", "the scans have " + std::to_string(points) + " points together, the limit is 2000000");
  }
  for (std::size_t number = 0; number < count; ++number) {
    const Pose& pose = sequence.T_odom_sensor[number];
    const std::string name = "pose " + std::to_string(number) + " of the sequence ";
    if (!usable(pose)) refuse(name + "is not a rigid transform");
    for (const double metres : pose.position) {
      if (std::fabs(metres) > kMaxOdometryM) refuse(name + "lies beyond 1e+08 m");
    }
  }
  const auto& last = sequence.T_odom_sensor.back().position;
  for (const Pose& pose : sequence.T_odom_sensor) {
    const auto& [x, y, z] = pose.position;
    if (std::hypot(x - last[0], y - last[1], z - last[2]) > kMaxWayM) refuse("a scan of the sequence lies over 1000 m from the last");
  }
}

}  // namespace detail
}  // namespace firstfix
