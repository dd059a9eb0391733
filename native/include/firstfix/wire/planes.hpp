// Integers as planes of bytes of equal weight, and the coordinates in them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/wire/bytes.hpp"

namespace firstfix::detail {

// Writes n values as planes of n bytes: first the least significant byte of every value, then the next.
inline void put_planes(Bytes& out, const std::vector<std::uint32_t>& values, std::size_t bytes) {
  std::size_t at = out.size();
  out.resize(at + bytes * values.size());
  for (std::size_t plane = 0; plane < bytes; ++plane) {
    for (const std::uint32_t value : values) out[at++] = static_cast<std::uint8_t>(value >> (8 * plane));
  }
}

// The inverse of put_planes, for the values from `first` to `first + size`.
inline void joined(const std::uint8_t* planes, std::size_t count, std::size_t bytes, std::size_t first, std::size_t size,
                   std::uint32_t* values) {
  std::fill(values, values + size, 0U);
  for (std::size_t plane = 0; plane < bytes; ++plane) {
    const std::uint8_t* part = planes + plane * count + first;
    const auto shift = static_cast<unsigned>(8 * plane);
    for (std::size_t i = 0; i < size; ++i) values[i] |= static_cast<std::uint32_t>(part[i]) << shift;
  }
}

// So many values at a time stay in the nearest cache.
constexpr std::size_t kValuesAtOnce = 512;

}  // namespace firstfix::detail

namespace firstfix {

// Decodes (count, 3) points from planes of differences: all bytes of x, then of y, then of z. Each coordinate has 2 or 4
// bytes; sums are modulo 2 ** (8 * bytes).
inline void points_of_planes(const std::uint8_t* planes, std::size_t count, std::size_t coordinate_bytes,
                             double resolution_m, const double* origin, float* points) {
  using detail::kValuesAtOnce;
  std::array<std::uint32_t, 3> sums{};
  std::array<std::uint32_t, kValuesAtOnce> values;
  std::array<std::array<float, kValuesAtOnce>, 3> metres;
  const unsigned spare = coordinate_bytes == 2 ? 16 : 0;  // bits above the number
  for (std::size_t first = 0; first < count; first += kValuesAtOnce) {
    const std::size_t size = std::min(kValuesAtOnce, count - first);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      detail::joined(planes + axis * coordinate_bytes * count, count, coordinate_bytes, first, size, values.data());
      std::uint32_t sum = sums[axis];
      for (std::size_t i = 0; i < size; ++i) values[i] = sum += values[i];
      sums[axis] = sum;
      const double origin_m = origin[axis];
      for (std::size_t i = 0; i < size; ++i) {
        const std::int32_t steps = static_cast<std::int32_t>(values[i] << spare) >> spare;  // with the number's sign
        metres[axis][i] = static_cast<float>(static_cast<double>(steps) * resolution_m + origin_m);
      }
    }
    float* out = points + 3 * first;
    for (std::size_t i = 0; i < size; ++i) {
      out[3 * i] = metres[0][i], out[3 * i + 1] = metres[1][i], out[3 * i + 2] = metres[2][i];
    }
  }
}

// Decodes intensities of one or two bytes.
inline void intensity_of_planes(const std::uint8_t* planes, std::size_t count, std::size_t bytes, double scale,
                                double offset, float* intensity) {
  std::array<std::uint32_t, detail::kValuesAtOnce> levels;
  for (std::size_t first = 0; first < count; first += detail::kValuesAtOnce) {
    const std::size_t size = std::min(detail::kValuesAtOnce, count - first);
    detail::joined(planes, count, bytes, first, size, levels.data());
    for (std::size_t i = 0; i < size; ++i) {
      intensity[first + i] = static_cast<float>(static_cast<double>(levels[i]) * scale + offset);
    }
  }
}

}  // namespace firstfix
