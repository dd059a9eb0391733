// Rays from one origin, in bundles of neighbours that are cast together.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

constexpr std::size_t kBundle = 16;

namespace detail {

inline void bundle(Vectors<const float> directions, std::uint32_t* begin, std::uint32_t* end) {
  const auto count = static_cast<std::size_t>(end - begin);
  if (count <= kBundle) return;
  float low[3], high[3];
  for (int a = 0; a < 3; ++a) low[a] = high[a] = directions[*begin][a];
  for (const std::uint32_t* row = begin; row < end; ++row) {
    for (int a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], directions[*row][a]);
      high[a] = std::max(high[a], directions[*row][a]);
    }
  }
  int axis = 0;
  for (int a = 1; a < 3; ++a) {
    if (high[a] - low[a] > high[axis] - low[axis]) axis = a;
  }
  const std::size_t bundles = (count + kBundle - 1) / kBundle;
  std::uint32_t* middle = begin + bundles / 2 * kBundle;  // only the last bundle may be short
  std::nth_element(begin, middle, end, [&](std::uint32_t x, std::uint32_t y) {
    const float a = directions[x][axis];
    const float b = directions[y][axis];
    return a < b || (a == b && x < y);
  });
  bundle(directions, begin, middle);
  bundle(directions, middle, end);
}

}  // namespace detail

// The order of directions in which each run of kBundle rays points to one place. A rotation does not change that.
inline std::vector<std::uint32_t> bundle_rays(Vectors<const float> directions) {
  std::vector<std::uint32_t> order(directions.size);
  for (std::size_t i = 0; i < directions.size; ++i) order[i] = static_cast<std::uint32_t>(i);
  if (directions.size) detail::bundle(directions, order.data(), order.data() + directions.size);
  return order;
}

}  // namespace firstfix
