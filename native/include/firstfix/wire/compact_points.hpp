// Decoding of a compact query: from cells and levels to points and ranges.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "firstfix/errors.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/wire/bytes.hpp"

namespace firstfix {

// The box of cells, of 16 steps each, in which the points lie: its lowest cell, and the cells along each axis.
struct CompactGrid {
  std::array<std::int64_t, 3> lowest{}, size{1, 1, 1};
  double resolution_m = 0;
};

// Decodes (count, 3) points. `planes` has 4 bytes for each: the cells' differences. `low` has 12 bits for each: the place in
// the cell. Throws "malformed_data".
inline void compact_points(const std::uint8_t* planes, const std::uint8_t* low, std::size_t count,
                           const CompactGrid& grid, float* points) {
  const auto difference = [&](std::size_t k) {
    return static_cast<std::uint64_t>(planes[k]) | static_cast<std::uint64_t>(planes[count + k]) << 8U |
           static_cast<std::uint64_t>(planes[2 * count + k]) << 16U |
           static_cast<std::uint64_t>(planes[3 * count + k]) << 24U;
  };
  const auto x = static_cast<std::uint64_t>(grid.size[0]), y = static_cast<std::uint64_t>(grid.size[1]);
  std::uint64_t number = 0;
  for (std::size_t k = 0; k < count; ++k) number += difference(k);
  if (count > 0 && number >= x * y * static_cast<std::uint64_t>(grid.size[2])) {
    throw Error("malformed_data", "a point of the query is outside its cells");
  }
  bool within = true;
  number = 0;
  for (std::size_t k = 0; k < count; ++k) {
    number += difference(k);
    const std::array<std::uint64_t, 3> cell{number % x, number / x % y, number / (x * y)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t half = 3 * k + axis;
      const auto place = (low[half / 2] >> (half % 2 == 0 ? 4U : 0U)) & 15U;
      const std::int64_t steps = (static_cast<std::int64_t>(cell[axis]) + grid.lowest[axis]) * 16 + place;
      const double metres = static_cast<double>(steps) * grid.resolution_m;
      within &= std::fabs(metres) <= kMaxAbsCoordinate * 1.001;
      points[half] = static_cast<float>(metres);
    }
  }
  if (!within) throw Error("malformed_data", "the query has coordinates beyond 1000 m");
}

// Decodes the ranges of `directions` directions, infinite where nothing returned: a bit for each, then for each return the
// difference of its level from the one before. `content` has at least the bits. Throws "malformed_data".
inline void ranges_of_levels(detail::ByteSpan content, const float* levels_m, std::size_t directions, float* nearest_m) {
  const std::size_t mask = (directions + 7) / 8, given = content.size - mask;
  std::size_t returned = 0;
  for (std::size_t i = 0; i < directions; ++i) returned += (content.data[i / 8] >> (7 - i % 8)) & 1U;
  if (returned != given) {
    throw Error("malformed_data", std::to_string(given) + " ranges for " + std::to_string(returned) + " directions");
  }
  const std::uint8_t* next = content.data + mask;
  std::uint8_t level = 0;
  for (std::size_t i = 0; i < directions; ++i) {
    nearest_m[i] = std::numeric_limits<float>::infinity();
    if (((content.data[i / 8] >> (7 - i % 8)) & 1U) == 0) continue;
    level = static_cast<std::uint8_t>(level + *next++);
    nearest_m[i] = levels_m[level];
  }
}

}  // namespace firstfix
