// Several scans with the sensor's motion between them.
#pragma once

#include <cmath>
#include <cstddef>
#include <variant>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/pose.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix {

constexpr std::size_t kMaxScans = 16;
constexpr double kMaxDistanceM = 1000.0;  // of a scan from the last one

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

inline void check(const ScanSequence& sequence) {
  const std::size_t count = sequence.scans.size();
  if (count == 0 || count != sequence.T_odom_sensor.size()) {
    throw Error("invalid_scan", "a sequence needs at least one scan, and one pose per scan");
  }
  if (count > kMaxScans) throw Error("too_large", "a sequence has at most 16 scans");
  std::size_t points = 0;
  for (const AnyScan& scan : sequence.scans) points += points_of(scan);
  if (points > kMaxPoints) throw Error("too_large", "the scans together have over 2,000,000 points");
  const auto& last = sequence.T_odom_sensor.back().position;
  for (const Pose& pose : sequence.T_odom_sensor) {
    const auto& [x, y, z] = pose.position;
    if (!usable(pose) || !(std::hypot(x - last[0], y - last[1], z - last[2]) <= kMaxDistanceM)) {
      throw Error("invalid_scan", "a pose of the sequence is not valid, or over 1000 m from the last");
    }
  }
}

}  // namespace detail
}  // namespace firstfix
