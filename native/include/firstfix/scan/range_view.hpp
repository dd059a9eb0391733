// The nearest range of a scan in each of 16,200 directions: cells of two degrees in the sensor frame.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix {

constexpr std::size_t kViewColumns = 180, kViewRows = 90, kDirections = kViewColumns * kViewRows;

namespace detail {

constexpr std::size_t kDrawnAtOnce = 256;  // points

// Lowers the (kDirections) ranges to those of at most kDrawnAtOnce points, coordinate by coordinate.
//
// across: of each point, the root of x x + y y.
inline void draw_points(const float* x, const float* y, const float* z, const float* across, std::size_t count,
                        float* nearest_m) {
  constexpr float kNearestM = 0.3F, kCellsATurn = 180.0F, kColumns = kViewColumns, kLastRow = kViewRows - 1;
  std::int32_t cell[kDrawnAtOnce];
  float range_m[kDrawnAtOnce];
  for (std::size_t i = 0; i < count; ++i) {
    const float distance = std::sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i]);
    const float column = (atan2_turns(y[i], x[i]) + 0.5F) * kCellsATurn;
    const float row = (atan2_turns(z[i], across[i]) + 0.25F) * kCellsATurn;
    // 0 for the angle of a point that is not finite: converting NaN to an integer is not defined
    const float c = (column > 0.0F) & (column < kColumns) ? column : 0.0F, up = row > 0.0F ? row : 0.0F;
    const float r = up < kLastRow ? up : kLastRow;
    cell[i] = static_cast<std::int32_t>(r) * static_cast<std::int32_t>(kViewColumns) + static_cast<std::int32_t>(c);
    range_m[i] = distance > kNearestM ? distance : std::numeric_limits<float>::infinity();
  }
  for (std::size_t i = 0; i < count; ++i) {
    const float nearest = nearest_m[cell[i]];
    nearest_m[cell[i]] = range_m[i] < nearest ? range_m[i] : nearest;
  }
}

}  // namespace detail

// Lowers the (kDirections) ranges to those of the points, x y z x y z. Points that are not finite have no direction.
inline void nearest_by_direction(const float* points, std::size_t count, float* nearest_m) {
  using detail::kDrawnAtOnce;
  float x[kDrawnAtOnce], y[kDrawnAtOnce], z[kDrawnAtOnce], across[kDrawnAtOnce];
  for (std::size_t start = 0; start < count; start += kDrawnAtOnce) {
    const std::size_t some = std::min(kDrawnAtOnce, count - start);
    const float* from = points + 3 * start;
    for (std::size_t i = 0; i < some; ++i) {
      x[i] = from[3 * i], y[i] = from[3 * i + 1], z[i] = from[3 * i + 2];
      across[i] = std::sqrt(x[i] * x[i] + y[i] * y[i]);
    }
    detail::draw_points(x, y, z, across, some, nearest_m);
  }
}

// The least range of each direction and its eight neighbours. The columns go around.
inline void least_of_neighbours(const float* nearest_m, float* least_m) {
  std::vector<float> across(kDirections);
  for (std::size_t row = 0; row < kDirections; row += kViewColumns) {
    const float* from = nearest_m + row;
    float* to = across.data() + row;
    constexpr std::size_t kLast = kViewColumns - 1;
    to[0] = std::min(std::min(from[kLast], from[1]), from[0]);
    to[kLast] = std::min(std::min(from[kLast - 1], from[0]), from[kLast]);
    for (std::size_t c = 1; c < kLast; ++c) to[c] = std::min(std::min(from[c - 1], from[c + 1]), from[c]);
  }
  for (std::size_t row = 0; row < kViewRows; ++row) {
    const float* here = across.data() + row * kViewColumns;
    const float* below = row == 0 ? here : here - kViewColumns;
    const float* above = row + 1 == kViewRows ? here : here + kViewColumns;
    float* to = least_m + row * kViewColumns;
    for (std::size_t c = 0; c < kViewColumns; ++c) to[c] = std::min(std::min(below[c], above[c]), here[c]);
  }
}

// Ranges of one scan by direction, for the poses at which it is compared with the map.
struct RangeView {
  std::vector<std::uint8_t> returned;  // (kDirections) 1: there are returns in the direction, and in enough of those around
  std::vector<float> least_m;          // (kDirections) nearest range in and around the direction
};

namespace detail {

// Number of filled cells among each filled cell and its eight neighbours, else 0. The columns go around.
inline std::vector<std::uint8_t> filled_around(const float* nearest_m) {
  std::vector<std::uint8_t> one(kDirections), across(kDirections), around(kDirections);
  for (std::size_t i = 0; i < kDirections; ++i) one[i] = std::isfinite(nearest_m[i]) ? 1 : 0;
  for (std::size_t row = 0; row < kDirections; row += kViewColumns) {
    constexpr std::size_t kLast = kViewColumns - 1;
    const std::uint8_t* from = one.data() + row;
    std::uint8_t* to = across.data() + row;
    to[0] = static_cast<std::uint8_t>(from[kLast] + from[0] + from[1]);
    to[kLast] = static_cast<std::uint8_t>(from[kLast - 1] + from[kLast] + from[0]);
    for (std::size_t c = 1; c < kLast; ++c) to[c] = static_cast<std::uint8_t>(from[c - 1] + from[c] + from[c + 1]);
  }
  for (std::size_t i = 0; i < kDirections; ++i) {
    const unsigned below = i < kViewColumns ? 0U : across[i - kViewColumns];
    const unsigned above = i + kViewColumns < kDirections ? across[i + kViewColumns] : 0U;
    around[i] = static_cast<std::uint8_t>((across[i] + below + above) * one[i]);
  }
  return around;
}

}  // namespace detail

// The view of (kDirections) nearest ranges, infinite in directions without a return. Beside a hole nobody knows what a ray
// would have met: so a direction needs returns in 7 of the 9 around it, but for a scan that is mostly holes.
inline RangeView range_view(const float* nearest_m) {
  constexpr unsigned kEnough = 7;
  RangeView view{detail::filled_around(nearest_m), std::vector<float>(kDirections)};
  std::size_t cells[10] = {};
  for (const std::uint8_t around : view.returned) ++cells[around];
  const std::size_t filled = kDirections - cells[0];
  unsigned usual = 1;  // of half of the filled cells
  for (std::size_t so_far = cells[1]; 2 * so_far < filled; so_far += cells[usual]) ++usual;
  const unsigned enough = usual >= kEnough ? kEnough : 1;
  for (std::uint8_t& around : view.returned) around = around >= enough ? 1 : 0;
  least_of_neighbours(nearest_m, view.least_m.data());
  return view;
}

}  // namespace firstfix
