// Points of a driver's message, without those that are not finite or impossibly far.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "firstfix/scan/scan.hpp"

namespace firstfix {

namespace detail {

template <typename Number>
Number number_at(const unsigned char* address) {
  Number number;
  std::memcpy(&number, address, sizeof number);
  return number;
}

}  // namespace detail

// Numbers in memory that another object owns, `stride` bytes apart: at any address, as those of a message are.
template <typename Number>
struct Column {
  const unsigned char* data = nullptr;
  std::ptrdiff_t stride = sizeof(Number);

  const unsigned char* at(std::size_t row) const { return data + static_cast<std::ptrdiff_t>(row) * stride; }

  Number operator[](std::size_t row) const { return detail::number_at<Number>(at(row)); }
};

namespace detail {

// Whether a coordinate may be that of a point. NaN compares false.
template <typename Number>
bool is_usable(Number metres) {
  return std::fabs(metres) <= static_cast<Number>(kMaxAbsCoordinate);
}

// Copies kCount points of kNumbers numbers each, one after the other, if all of them are usable: few of a driver's are not.
template <std::size_t kNumbers, std::size_t kCount, typename Number>
bool copy_if_usable(const unsigned char* from, float* to) {
  Number numbers[kNumbers * kCount];
  std::memcpy(numbers, from, sizeof(Number) * (kNumbers * (kCount - 1) + 3));
  int usable = 1;  // an integer and one loop: compilers then take many numbers at once
  if (kNumbers == 3) {
    for (std::size_t i = 0; i < 3 * kCount; ++i) usable &= is_usable(numbers[i]) ? 1 : 0;
  } else {
    for (std::size_t i = 0; i < kCount; ++i) {
      usable &= (is_usable(numbers[kNumbers * i]) & is_usable(numbers[kNumbers * i + 1]) & is_usable(numbers[kNumbers * i + 2])) ? 1 : 0;
    }
  }
  if (usable == 0) return false;
  for (std::size_t i = 0; i < kCount; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) to[3 * i + axis] = static_cast<float>(numbers[kNumbers * i + axis]);
  }
  return true;
}

}  // namespace detail

// Copies the usable ones of `count` points to `points` (count, 3), and tells for each whether it is usable. Returns their
// number.
template <typename Number>
std::size_t usable_points(Column<Number> x, Column<Number> y, Column<Number> z, std::size_t count, float* points,
                          bool* usable) {
  constexpr std::size_t kAtOnce = 64;
  constexpr std::ptrdiff_t kBytes = sizeof(Number);
  const bool in_rows = y.data == x.data + kBytes && z.data == y.data + kBytes && x.stride == y.stride && x.stride == z.stride;
  std::size_t found = 0;
  for (std::size_t start = 0; start < count; start += kAtOnce) {
    const std::size_t end = std::min(start + kAtOnce, count);
    if (in_rows && end == start + kAtOnce) {
      float* to = points + 3 * found;
      if ((x.stride == 3 * kBytes && detail::copy_if_usable<3, kAtOnce, Number>(x.at(start), to)) ||
          (x.stride == 4 * kBytes && detail::copy_if_usable<4, kAtOnce, Number>(x.at(start), to))) {
        std::fill(usable + start, usable + end, true);
        found += kAtOnce;
        continue;
      }
    }
    for (std::size_t i = start; i < end; ++i) {
      const Number px = x[i], py = y[i], pz = z[i];
      const bool taken = detail::is_usable(px) & detail::is_usable(py) & detail::is_usable(pz);
      float* next = points + 3 * found;
      next[0] = static_cast<float>(px), next[1] = static_cast<float>(py), next[2] = static_cast<float>(pz);
      usable[i] = taken;
      found += static_cast<std::size_t>(taken);
    }
  }
  return found;
}

// True if no coordinate of the (count, 3) points is NaN or beyond the limit.
inline bool all_within(const float* points, std::size_t count, double limit_m) {
  bool within = true;
  for (std::size_t i = 0; i < 3 * count; ++i) within &= std::fabs(static_cast<double>(points[i])) <= limit_m;
  return within;
}

}  // namespace firstfix
