// The nearest point in each direction, at any resolution, and around each direction.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

// Ranges of points by direction from the sensor. There are half as many rows as columns, and the columns go around.
class RangeImage {
 public:
  std::vector<float> nearest_m;       // to the nearest point, infinite where there is none
  std::vector<float> least_m;         // least range in and around each direction, infinite where there is none
  std::vector<float> most_m;          // largest one, minus infinity where there is none
  std::vector<std::uint8_t> covered;  // enough points are around the direction, and on both of its sides

  // Points whose range is not finite are in no direction.
  RangeImage(Vectors<const float> points, std::int32_t columns)
      : nearest_m(static_cast<std::size_t>(columns) * static_cast<std::size_t>(columns / 2), kInfinity),
        columns_(columns),
        rows_(columns / 2) {
    std::vector<std::int32_t> cell(points.size);
    std::vector<float> range_m(points.size);
    for (std::size_t i = 0; i < points.size; ++i) {
      const float x = points[i][0], y = points[i][1], z = points[i][2];
      cell[i] = at(x, y, z);
      range_m[i] = std::sqrt(x * x + y * y + z * z);
    }
    for (std::size_t i = 0; i < points.size; ++i) {
      if (range_m[i] < nearest_m[cell[i]]) nearest_m[cell[i]] = range_m[i];
    }
    look_around();
  }

  // The place of a point's direction in the arrays.
  std::int32_t at(float x, float y, float z) const {
    const auto turn = static_cast<float>(columns_);
    // 0 for the angle of what is not a number: converting it to an integer is not defined
    const float column = std::max(0.0F, (detail::atan2_turns(y, x) + 0.5F) * turn);
    const float row = std::max(0.0F, (detail::atan2_turns(z, std::sqrt(x * x + y * y)) + 0.25F) * turn);
    const auto c = static_cast<std::int32_t>(column);
    return std::min(static_cast<std::int32_t>(row), rows_ - 1) * columns_ + (c < columns_ ? c : 0);
  }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr int kEnough = 3;  // of a direction and its eight neighbours that have a point

  std::int32_t columns_, rows_;

  void look_around() {
    const std::size_t columns = static_cast<std::size_t>(columns_), rows = static_cast<std::size_t>(rows_);
    // row by row: the least and largest range, how many have a point, and whether the three above each other have any
    std::vector<float> least(nearest_m.size()), most(nearest_m.size());
    std::vector<std::uint8_t> filled(nearest_m.size()), in_row(nearest_m.size()), in_column(nearest_m.size());
    for (std::size_t row = 0; row < rows; ++row) {
      const float* here = &nearest_m[row * columns];
      const float* below = row == 0 ? here : here - columns;
      const float* above = row + 1 == rows ? here : here + columns;
      for (std::size_t c = 0; c < columns; ++c) {
        const float left = here[c == 0 ? columns - 1 : c - 1], right = here[c + 1 == columns ? 0 : c + 1];
        const std::size_t i = row * columns + c;
        least[i] = std::min(std::min(left, right), here[c]);
        most[i] = std::max(std::max(finite(left), finite(right)), finite(here[c]));
        filled[i] = static_cast<std::uint8_t>((left < kInfinity) + (here[c] < kInfinity) + (right < kInfinity));
        in_row[i] = filled[i] > 0;
        in_column[i] = here[c] < kInfinity || below[c] < kInfinity || above[c] < kInfinity;
      }
    }
    least_m.resize(nearest_m.size());
    most_m.resize(nearest_m.size());
    covered.resize(nearest_m.size());
    for (std::size_t row = 0; row < rows; ++row) {
      const bool is_lowest = row == 0, is_highest = row + 1 == rows;
      for (std::size_t c = 0; c < columns; ++c) {
        const std::size_t i = row * columns + c, below = is_lowest ? i : i - columns, above = is_highest ? i : i + columns;
        const std::size_t left = c == 0 ? i + columns - 1 : i - 1, right = c + 1 == columns ? i + 1 - columns : i + 1;
        least_m[i] = std::min(std::min(least[below], least[above]), least[i]);
        most_m[i] = std::max(std::max(most[below], most[above]), most[i]);
        const int enough = filled[i] + (is_lowest ? 0 : filled[below]) + (is_highest ? 0 : filled[above]);
        const bool is_between_rows = !is_lowest && !is_highest && in_row[below] && in_row[above];
        const bool is_between_columns = in_column[left] && in_column[right];
        covered[i] = (in_row[i] || is_between_rows) && (in_column[i] || is_between_columns) && enough >= kEnough;
      }
    }
  }

  static float finite(float range_m) { return range_m < kInfinity ? range_m : -kInfinity; }
};

}  // namespace firstfix
