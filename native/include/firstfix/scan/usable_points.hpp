// Points of a driver's message, without those that are not finite or impossibly far.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firstfix/scan/scan.hpp"

namespace firstfix {

// Numbers in memory that another object owns; two of them are `stride` numbers apart.
template <typename Number>
struct Column {
  const Number* data = nullptr;
  std::ptrdiff_t stride = 1;

  Number operator[](std::size_t row) const { return data[static_cast<std::ptrdiff_t>(row) * stride]; }
};

// Copies the usable ones of `count` points to `points` (count, 3), and tells for each whether it is usable. Returns their
// number.
template <typename Number>
std::size_t usable_points(Column<Number> x, Column<Number> y, Column<Number> z, std::size_t count, float* points,
                          bool* usable) {
  constexpr auto kMost = static_cast<Number>(kMaxAbsCoordinate);
  std::size_t found = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Number px = x[i], py = y[i], pz = z[i];
    // NaN compares false.
    const bool within = (std::fabs(px) <= kMost) & (std::fabs(py) <= kMost) & (std::fabs(pz) <= kMost);
    float* next = points + 3 * found;
    next[0] = static_cast<float>(px), next[1] = static_cast<float>(py), next[2] = static_cast<float>(pz);
    usable[i] = within;
    found += static_cast<std::size_t>(within);
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
