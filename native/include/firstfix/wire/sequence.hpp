// The encoding application/vnd.firstfix.scans: several scans with the sensor's poses. clients/protocol/scan.md
// specifies every byte.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/pose.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/sequence.hpp"
#include "firstfix/wire/bytes.hpp"
#include "firstfix/wire/query.hpp"
#include "firstfix/wire/scan.hpp"

namespace firstfix {

inline constexpr const char* kScansMediaType = "application/vnd.firstfix.scans";

// Encodes a sequence. Throws "invalid_scan", "too_large", and what the encoders of one scan throw.
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

// Decodes a sequence, its quaternions as they were sent. Throws what the decoders of one scan throw, and "invalid_scan" for an invalid pose.
inline ScanSequence decode_scans(const std::uint8_t* data, std::size_t size) {
  detail::Reader rest(data, size, kScansMediaType);
  rest.magic("FFSS");
  const std::size_t version = rest.get<std::uint8_t>(), count = rest.get<std::uint8_t>();
  if (rest.get<std::uint16_t>() != 0) throw Error("malformed_data", "a reserved field of the sequence is not 0");
  if (version != 1) throw Error("unsupported_format", "only version 1 is supported");
  if (count > kMaxScans) throw Error("too_large", "a sequence has at most 16 scans");
  ScanSequence sequence;
  std::size_t points = 0;
  for (std::size_t i = 0; i < count; ++i) {
    Pose pose;
    for (double& v : pose.position) v = rest.get<double>();
    for (double& v : pose.quaternion) v = rest.get<double>();
    const detail::ByteSpan part = rest.take(rest.get<std::uint32_t>());
    if (part.size >= 4 && std::memcmp(part.data, "FFQY", 4) == 0) {
      Query query = decode_query(part.data, part.size);
      auto* compact = std::get_if<CompactScan>(&query);
      if (compact == nullptr) throw Error("malformed_data", "a scan of the sequence is a descriptor without points");
      sequence.scans.emplace_back(std::move(*compact));
    } else {
      sequence.scans.emplace_back(decode_scan(part.data, part.size));
    }
    points += detail::points_of(sequence.scans.back());
    if (points > kMaxPoints) throw Error("too_large", "the scans together have over 2,000,000 points");
    sequence.T_odom_sensor.push_back(pose);
  }
  rest.end();
  detail::check(sequence);
  return sequence;
}

inline ScanSequence decode_scans(const Bytes& body) { return decode_scans(body.data(), body.size()); }

}  // namespace firstfix
