// The encoding application/vnd.firstfix.scans: several scans and the way between them.
// clients/protocol/scan.md has every byte.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "bytes.hpp"
#include "compact_scan.hpp"
#include "errors.hpp"
#include "pose.hpp"
#include "scan.hpp"
#include "wire.hpp"
#include "wire_query.hpp"

namespace firstfix {

inline constexpr const char* kScansMediaType = "application/vnd.firstfix.scans";
constexpr std::size_t kMaxScans = 16;
constexpr double kMaxWay = 1000.0;  // m, of a scan from the last

using AnyScan = std::variant<Scan, CompactScan>;

struct ScanSequence {
  std::vector<AnyScan> scans;        // as they were taken
  std::vector<Pose> T_odom_sensor;   // of each, in any one frame that does not move
};

namespace detail {

inline std::size_t points_of(const AnyScan& scan) {
  return std::visit([](const auto& one) { return one.points.size(); }, scan);
}

inline void check(const ScanSequence& sequence) {
  const std::size_t count = sequence.scans.size();
  if (count == 0 || count != sequence.T_odom_sensor.size()) {
    throw Error("invalid_scan", "a sequence has a scan, and as many poses as scans");
  }
  if (count > kMaxScans) throw Error("too_large", "a sequence holds up to 16 scans");
  std::size_t points = 0;
  for (const AnyScan& scan : sequence.scans) points += points_of(scan);
  if (points > kMaxPoints) throw Error("too_large", "the scans have over 2,000,000 points together");
  const auto& last = sequence.T_odom_sensor.back().position;
  for (const Pose& pose : sequence.T_odom_sensor) {
    const auto& [x, y, z] = pose.position;
    if (!usable(pose) || !(std::hypot(x - last[0], y - last[1], z - last[2]) <= kMaxWay)) {
      throw Error("invalid_scan", "a pose of the sequence is none, or over 1000 m from the last");
    }
  }
}

}  // namespace detail

// Throws "invalid_scan", "too_large", and as the encoders of one scan.
inline Bytes encode_scans(const ScanSequence& sequence, std::optional<double> resolution_m = std::nullopt,
                          std::optional<double> voxel_m = std::nullopt, ScanForm form = ScanForm::points) {
  detail::check(sequence);
  Bytes body{'F', 'F', 'S', 'S', 1, static_cast<std::uint8_t>(sequence.scans.size()), 0, 0};
  for (std::size_t i = 0; i < sequence.scans.size(); ++i) {
    const Pose pose = detail::normalised(sequence.T_odom_sensor[i]);
    for (const double v : pose.position) detail::put(body, v);
    for (const double v : pose.quaternion) detail::put(body, v);
    const auto* whole = std::get_if<Scan>(&sequence.scans[i]);
    const Bytes scan = whole != nullptr ? encode_scan(*whole, resolution_m, voxel_m, form)
                                        : encode_query(std::get<CompactScan>(sequence.scans[i]));
    detail::put(body, static_cast<std::uint32_t>(scan.size()));
    detail::append(body, scan);
  }
  return body;
}

// What encode_scans was given. Throws as the decoders of one scan, and "invalid_scan" for poses that are none.
inline ScanSequence decode_scans(const std::uint8_t* data, std::size_t size) {
  detail::Reader rest(data, size, kScansMediaType);
  rest.magic("FFSS");
  const std::size_t version = rest.get<std::uint8_t>(), count = rest.get<std::uint8_t>();
  if (rest.get<std::uint16_t>() != 0) throw Error("malformed_data", "a reserved field of the sequence is set");
  if (version != 1) throw Error("unsupported_format", "this reads version 1");
  if (count > kMaxScans) throw Error("too_large", "a sequence holds up to 16 scans");
  ScanSequence sequence;
  std::size_t points = 0;
  for (std::size_t i = 0; i < count; ++i) {
    Pose pose;
    for (double& v : pose.position) v = rest.get<double>();
    for (double& v : pose.quaternion) v = rest.get<double>();
    const detail::Span part = rest.take(rest.get<std::uint32_t>());
    if (part.size >= 4 && std::memcmp(part.data, "FFQY", 4) == 0) {
      Query query = decode_query(part.data, part.size);
      auto* compact = std::get_if<CompactScan>(&query);
      if (compact == nullptr) throw Error("malformed_data", "a descriptor without points in a sequence");
      sequence.scans.emplace_back(std::move(*compact));
    } else {
      sequence.scans.emplace_back(decode_scan(part.data, part.size));
    }
    points += detail::points_of(sequence.scans.back());
    if (points > kMaxPoints) throw Error("too_large", "the scans have over 2,000,000 points together");
    sequence.T_odom_sensor.push_back(pose);
  }
  rest.end();
  detail::check(sequence);
  for (Pose& pose : sequence.T_odom_sensor) pose = detail::normalised(pose);
  return sequence;
}

inline ScanSequence decode_scans(const Bytes& body) { return decode_scans(body.data(), body.size()); }

}  // namespace firstfix
