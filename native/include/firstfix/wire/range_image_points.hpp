// Decoding of a range image: from its gaps and ranges to points.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/wire/bytes.hpp"

namespace firstfix::detail {

constexpr std::uint32_t kWideGap = 15, kWideRange = 255;

// Replaces each escape value by the next wide number.
inline void take_wide(std::vector<std::uint32_t>& numbers, std::uint32_t escape, ByteSpan rest, std::size_t planes) {
  const auto wide = static_cast<std::size_t>(std::count(numbers.begin(), numbers.end(), escape));
  if (rest.size != planes * wide) {
    throw Error("malformed_data", std::to_string(wide) + " wide numbers of the range image do not fit " +
                                      std::to_string(rest.size) + " bytes");
  }
  if (wide == 0) return;
  std::size_t k = 0;
  for (std::uint32_t& number : numbers) {
    if (number != escape) continue;
    number = 0;
    for (std::size_t plane = 0; plane < planes; ++plane) {
      number |= static_cast<std::uint32_t>(rest.data[plane * wide + k]) << (8 * plane);
    }
    ++k;
  }
}

inline std::vector<std::uint32_t> unpacked_gaps(ByteSpan content, std::size_t count) {
  std::vector<std::uint32_t> gaps(count + count % 2);
  const std::size_t halves = gaps.size() / 2;
  for (std::size_t k = 0; k < halves; ++k) {
    gaps[2 * k] = content.data[k] >> 4U;
    gaps[2 * k + 1] = content.data[k] & 15U;
  }
  if (count % 2 == 1 && gaps.back() != 0) {
    throw Error("malformed_data", "the four bits after the last gap of the range image are not 0");
  }
  gaps.resize(count);
  take_wide(gaps, kWideGap, {content.data + halves, content.size - halves}, 3);
  return gaps;
}

// Ranges in steps, none of them 0.
inline std::vector<std::uint32_t> unpacked_ranges(ByteSpan content, std::size_t count) {
  std::vector<std::uint32_t> steps(content.data, content.data + count);
  take_wide(steps, kWideRange, {content.data + count, content.size - count}, 2);
  std::uint32_t sum = 0;
  bool zero = false;
  for (std::uint32_t& step : steps) {
    sum = (sum + ((step >> 1U) ^ (0U - (step & 1U)))) & 0xffffU;
    zero |= sum == 0;
    step = sum;
  }
  if (zero) throw Error("malformed_data", "a return of the range image has the range 0");
  return steps;
}

}  // namespace firstfix::detail

namespace firstfix {

// Cosines and sines of equally spaced angles.
struct Angles {
  std::size_t count = 0;
  const double *cosines = nullptr, *sines = nullptr;
};

// Decodes the `count` points of a range image with a column for each azimuth and a row for each elevation. `gaps` has at
// least a byte for two points, `ranges` at least a byte for one. Throws "malformed_data".
inline void range_image_points(detail::ByteSpan gaps, detail::ByteSpan ranges, std::size_t count, double resolution_m,
                               const Angles& azimuths, const Angles& elevations, float* points) {
  const std::vector<std::uint32_t> apart = detail::unpacked_gaps(gaps, count);
  std::uint64_t reached = count;  // cells up to the last return
  for (const std::uint32_t gap : apart) reached += gap;
  if (reached > azimuths.count * elevations.count) {
    throw Error("malformed_data", "a return of the range image is outside its grid");
  }
  const std::vector<std::uint32_t> steps = detail::unpacked_ranges(ranges, count);
  std::size_t row = 0, column = 0;
  for (std::size_t k = 0; k < count; ++k) {
    for (column += apart[k]; column >= azimuths.count; column -= azimuths.count) ++row;
    const double distance = static_cast<double>(steps[k]) * resolution_m, across = distance * elevations.cosines[row];
    points[3 * k] = static_cast<float>(across * azimuths.cosines[column]);
    points[3 * k + 1] = static_cast<float>(across * azimuths.sines[column]);
    points[3 * k + 2] = static_cast<float>(distance * elevations.sines[row]);
    ++column;
  }
}

}  // namespace firstfix
