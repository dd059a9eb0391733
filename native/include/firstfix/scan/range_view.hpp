// The nearest range of a scan in each of 16,200 directions: cells of two degrees in the sensor frame.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "firstfix/portable/atan2.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix {

constexpr std::size_t kViewColumns = 180, kViewRows = 90, kDirections = kViewColumns * kViewRows;

namespace detail {

// The nearest range in every direction, infinite where there is no return.
inline std::vector<float> nearest_by_direction(const std::vector<Point>& points) {
  std::vector<float> nearest(kDirections, std::numeric_limits<float>::infinity());
  for (const Point& p : points) {
    const float across2 = p.x * p.x + p.y * p.y;
    const float distance = std::sqrt(across2 + p.z * p.z);
    if (!(distance > 0.3F)) continue;
    const auto column = static_cast<std::size_t>((atan2_turns(p.y, p.x) + 0.5F) * 180.0F) % kViewColumns;
    const auto row = static_cast<std::size_t>((atan2_turns(p.z, std::sqrt(across2)) + 0.25F) * 180.0F);
    float& cell = nearest[std::min(row, kViewRows - 1) * kViewColumns + column];
    cell = std::min(cell, distance);
  }
  return nearest;
}

}  // namespace detail
}  // namespace firstfix
