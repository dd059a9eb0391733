// Kind 2 of application/vnd.firstfix.scan: a range image. clients/protocol/range-image.md specifies every byte.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/wire/bytes.hpp"
#include "firstfix/wire/range_image_points.hpp"
#include "firstfix/wire/times.hpp"
#include "firstfix/wire/zstd_frame.hpp"

namespace firstfix::detail {

constexpr std::uint16_t kImageColumns = 4096, kImageRows = 1024;
constexpr double kMinImageResolution = 0.005;  // m
constexpr std::size_t kMaxImageCells = std::size_t{1} << 24U;
constexpr std::uint32_t kMaxImageSteps = 65'535;

// Radix sort by the lower `bits` bits, 11 bits per pass.
inline void sort_keys(std::vector<std::uint64_t>& keys, unsigned bits) {
  constexpr unsigned kDigit = 11;
  std::vector<std::uint64_t> sorted(keys.size());
  for (unsigned shift = 0; shift < bits; shift += kDigit) {
    const auto digit = [shift](std::uint64_t key) { return (key >> shift) & ((1U << kDigit) - 1); };
    std::vector<std::size_t> place((std::size_t{1} << kDigit) + 1);
    for (const std::uint64_t key : keys) ++place[digit(key) + 1];
    for (std::size_t i = 1; i < place.size(); ++i) place[i] += place[i - 1];
    for (const std::uint64_t key : keys) sorted[place[digit(key)]++] = key;
    keys.swap(sorted);
  }
}

// For every cell with a return: the cell number, the nearest range in steps (16 bits), and the level of its time (8 bits).
// Ascending. times: of all points, or null: the levels are 0.
inline std::vector<std::uint64_t> nearest_by_cell(const std::vector<Point>& points, double resolution_m,
                                                  const Times* times) {
  std::vector<std::uint64_t> keys;
  keys.reserve(points.size());
  const double steps_a_metre = 1 / resolution_m;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Point& p = points[i];
    const float across2 = p.x * p.x + p.y * p.y;
    const float distance = std::sqrt(across2 + p.z * p.z);
    const double steps = std::nearbyint(static_cast<double>(distance) * steps_a_metre);
    if (!(steps >= 1 && steps <= kMaxImageSteps)) continue;
    const auto column = static_cast<std::uint64_t>((atan2_turns(p.y, p.x) + 0.5F) * kImageColumns) % kImageColumns;
    const auto row = static_cast<std::uint64_t>((atan2_turns(p.z, std::sqrt(across2)) + 0.25F) * (2 * kImageRows));
    const std::uint64_t cell = std::min<std::uint64_t>(row, kImageRows - 1) * kImageColumns + column;
    const std::uint64_t level = times == nullptr ? 0 : times->level[i];
    keys.push_back(cell << 24U | static_cast<std::uint64_t>(steps) << 8U | level);
  }
  sort_keys(keys, 46);  // 22 bits of the cell, 16 of the range, 8 of the time
  const auto same_cell = [](std::uint64_t a, std::uint64_t b) { return a >> 24U == b >> 24U; };
  keys.erase(std::unique(keys.begin(), keys.end(), same_cell), keys.end());
  return keys;
}

// Writes the numbers that are not below the escape value as planes of bytes, least significant first.
inline void put_wide(Bytes& out, const std::vector<std::uint32_t>& numbers, std::uint32_t escape, unsigned planes) {
  for (unsigned plane = 0; plane < planes; ++plane) {
    for (const std::uint32_t number : numbers) {
      if (number >= escape) out.push_back(static_cast<std::uint8_t>(number >> (8 * plane)));
    }
  }
}

inline Bytes packed_gaps(const std::vector<std::uint32_t>& gaps) {
  Bytes packed((gaps.size() + 1) / 2);
  for (std::size_t k = 0; k < gaps.size(); ++k) {
    packed[k / 2] = static_cast<std::uint8_t>(packed[k / 2] | std::min(gaps[k], kWideGap) << (k % 2 == 0 ? 4U : 0U));
  }
  put_wide(packed, gaps, kWideGap, 3);
  return packed;
}

inline Bytes packed_ranges(const std::vector<std::uint32_t>& zigzag) {
  Bytes packed(zigzag.size());
  for (std::size_t k = 0; k < zigzag.size(); ++k) {
    packed[k] = static_cast<std::uint8_t>(std::min(zigzag[k], kWideRange));
  }
  put_wide(packed, zigzag, kWideRange, 2);
  return packed;
}

// Writes the part of a scan after its first six bytes.
inline void put_range_image(Bytes& body, const Scan& scan, double resolution_m) {
  std::optional<Times> times;
  if (scan.time_s) times = times_of(*scan.time_s, scan.points.size());
  const std::vector<std::uint64_t> keys = nearest_by_cell(scan.points, resolution_m, times ? &*times : nullptr);
  std::vector<std::uint32_t> gaps(keys.size()), zigzag(keys.size());
  std::uint32_t next_cell = 0, before = 0;
  for (std::size_t k = 0; k < keys.size(); ++k) {
    const auto cell = static_cast<std::uint32_t>(keys[k] >> 24U);
    const auto steps = static_cast<std::uint32_t>(keys[k] >> 8U & 0xffffU);
    gaps[k] = cell - next_cell;
    next_cell = cell + 1;
    const std::uint32_t difference = (steps - before) & 0xffffU;
    zigzag[k] = ((difference << 1U) ^ ((difference & 0x8000U) != 0 ? 0xffffU : 0U)) & 0xffffU;
    before = steps;
  }
  if (times) {
    times->level.resize(keys.size());
    for (std::size_t k = 0; k < keys.size(); ++k) times->level[k] = static_cast<std::uint8_t>(keys[k]);
    put_times(body, *times, 1, true);
  }
  const Bytes gap_frame = compressed(packed_gaps(gaps), 1, true);
  put(body, kImageColumns);
  put(body, static_cast<std::uint32_t>(keys.size()));
  put(body, kImageRows);
  put(body, std::uint16_t{0});
  put(body, resolution_m);
  put(body, scan.stamp_s.value_or(std::numeric_limits<double>::quiet_NaN()));
  put(body, static_cast<std::uint32_t>(gap_frame.size()));
  append(body, gap_frame);
  append(body, compressed(packed_ranges(zigzag), 1, true));
}

// The middles of equal parts of an arc that ends at `last`.
struct ArcTable {
  std::vector<double> cosines, sines;

  ArcTable(std::size_t parts, double arc, double last) : cosines(parts), sines(parts) {
    for (std::size_t i = 0; i < parts; ++i) {
      const double angle = (static_cast<double>(i) + 0.5) * (arc / static_cast<double>(parts)) - last;
      cosines[i] = std::cos(angle), sines[i] = std::sin(angle);
    }
  }

  Angles angles() const { return {cosines.size(), cosines.data(), sines.data()}; }
};

// Reads the part of a scan after its first six bytes. timed: it begins with the times of the returns.
inline Scan take_range_image(Reader& rest, bool timed) {
  std::optional<TimesPart> times;
  if (timed) times = TimesPart::read(rest);
  const std::size_t columns = rest.get<std::uint16_t>(), count = rest.get<std::uint32_t>();
  const std::size_t rows = rest.get<std::uint16_t>();
  const auto zero = rest.get<std::uint16_t>();
  const auto resolution_m = rest.get<double>(), stamp_s = rest.get<double>();
  const std::size_t gap_bytes = rest.get<std::uint32_t>();
  if (count > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
  if (!(columns >= 4 && rows >= 2 && columns * rows <= kMaxImageCells && zero == 0 &&
        resolution_m >= kMinImageResolution && resolution_m <= 1 && !std::isinf(stamp_s))) {
    throw Error("malformed_data", "a field of the range image's header is out of range");
  }
  const std::size_t halves = (count + 1) / 2;
  const Bytes gap_content = decompressed(rest.take(gap_bytes), halves, halves + 3 * count);
  const Bytes range_content = decompressed(rest.take(rest.left()), count, 3 * count);
  Scan scan;
  scan.points.resize(count);
  const ArcTable azimuths(columns, 2 * kPi, kPi), elevations(rows, kPi, kPi / 2);
  range_image_points(span_of(gap_content), span_of(range_content), count, resolution_m, azimuths.angles(),
                     elevations.angles(), numbers_of(scan.points));
  if (!std::isnan(stamp_s)) scan.stamp_s = stamp_s;
  if (times) scan.time_s = times->time_s(count);
  return scan;
}

}  // namespace firstfix::detail
