// Poses as matrices, between the frame of a map and the level frame of its templates.
#pragma once

#include <array>
#include <cstddef>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix::version {

constexpr PoseMatrix kSameFrame{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

inline PoseMatrix product(const PoseMatrix& a, const PoseMatrix& b) {
  PoseMatrix made{};
  for (std::size_t row = 0; row < 4; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      for (std::size_t k = 0; k < 4; ++k) made[4 * row + column] += a[4 * row + k] * b[4 * k + column];
    }
  }
  return made;
}

// A point of the map in the frame of the templates.
inline detail::Vector3 in_level(const PoseMatrix& T_map_level, const std::array<double, 3>& point_m) {
  detail::Vector3 made{};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t k = 0; k < 3; ++k) made[row] += T_map_level[4 * k + row] * (point_m[k] - T_map_level[4 * k + 3]);
  }
  return made;
}

}  // namespace firstfix::version
