// Times of a scan's points, one byte each: the part that all encodings of a scan share. clients/protocol/scan.md specifies
// every byte.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/wire/bytes.hpp"
#include "firstfix/wire/zstd_frame.hpp"

namespace firstfix::detail {

constexpr double kTimeLevels = 255;                 // beside level 0
constexpr double kTimeLimit = kMaxAbsTime * 1.001;  // s

// Times of points: time = first + step * level.
struct Times {
  float first_s = 0, step_s = 0;
  std::vector<std::uint8_t> level;
};

// Levels from the first to the last of the times, in the smallest steps that suffice: a power of two. Throws "invalid_scan" if there is not one for each point, within a second.
inline Times times_of(const std::vector<float>& time_s, std::size_t points) {
  const auto is_near = [](float t) { return std::fabs(static_cast<double>(t)) <= kMaxAbsTime; };  // false for NaN
  if (time_s.size() != points) throw Error("invalid_scan", "the number of times is not the number of points");
  if (!std::all_of(time_s.begin(), time_s.end(), is_near)) {
    throw Error("invalid_scan", "a point's time is not within 1 s of the scan's stamp");
  }
  double step_s = 1.0 / 1048576;
  Times times{0, static_cast<float>(step_s), std::vector<std::uint8_t>(points)};
  if (points == 0) return times;
  const auto [first, last] = std::minmax_element(time_s.begin(), time_s.end());
  const auto steps_of = [&](float t) { return std::nearbyint(static_cast<double>(t) / step_s); };
  while (steps_of(*last) - steps_of(*first) > kTimeLevels) step_s *= 2;
  const double start = steps_of(*first);
  for (std::size_t i = 0; i < points; ++i) times.level[i] = static_cast<std::uint8_t>(steps_of(time_s[i]) - start);
  times.first_s = static_cast<float>(start * step_s);
  times.step_s = static_cast<float>(step_s);
  return times;
}

inline void put_times(Bytes& body, const Times& times, int zstd_level, bool checksum) {
  Bytes differences(times.level.size());
  std::uint8_t before = 0;
  for (std::size_t i = 0; i < differences.size(); ++i) {
    differences[i] = static_cast<std::uint8_t>(times.level[i] - before);
    before = times.level[i];
  }
  const Bytes frame = compressed(differences, zstd_level, checksum);
  put(body, times.first_s);
  put(body, times.step_s);
  put(body, static_cast<std::uint32_t>(frame.size()));
  append(body, frame);
}

// The part as it was received. Its frame is read when the number of points is known.
struct TimesPart {
  double first_s, step_s;
  ByteSpan frame;

  // Throws "malformed_data".
  static TimesPart read(Reader& rest) {
    TimesPart part{};
    part.first_s = static_cast<double>(rest.get<float>());
    part.step_s = static_cast<double>(rest.get<float>());
    const std::size_t length = rest.get<std::uint32_t>();
    if (!(std::fabs(part.first_s) <= kTimeLimit && part.step_s >= 0 && part.step_s <= 1)) {
      throw Error("malformed_data", "a field of the times' header is out of range");
    }
    part.frame = rest.take(length);
    return part;
  }

  // Throws "malformed_data".
  std::vector<float> time_s(std::size_t points) const {
    const Bytes content = decompressed(frame, points, points);
    std::vector<float> times(points);
    std::uint8_t level = 0;
    bool within = true;
    for (std::size_t i = 0; i < points; ++i) {
      level = static_cast<std::uint8_t>(level + content[i]);
      const double time = first_s + step_s * static_cast<double>(level);
      within &= time <= kTimeLimit;
      times[i] = static_cast<float>(time);
    }
    if (!within) throw Error("malformed_data", "a point's time is over 1 s from the scan's stamp");
    return times;
  }
};

}  // namespace firstfix::detail
