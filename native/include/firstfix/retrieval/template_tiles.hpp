// Templates in square tiles, to find those near a position.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

// Rows of templates, tile after tile in columns along y: in tile (x, y) are row[begin[x, y]] to row[begin[x, y + 1]].
struct TemplateTiles {
  static constexpr double kTileM = 5.0;

  const std::int32_t* row = nullptr;    // (n)
  const std::int32_t* begin = nullptr;  // (columns, rows + 1)
  std::size_t columns = 0, rows = 0;
  std::int32_t low[2] = {0, 0};  // x and y of the first tile, in tiles

  // Throws std::invalid_argument where a table points outside of another one. count: of templates.
  void check(std::size_t count) const {
    const auto require = [](bool holds, const char* message) {
      if (!holds) throw std::invalid_argument(message);
    };
    const auto point_into = [](const std::int32_t* numbers, std::size_t size, std::size_t end) {
      return std::all_of(numbers, numbers + size, [end](std::int32_t number) {
        return number >= 0 && static_cast<std::size_t>(number) < end;
      });
    };
    require(point_into(row, count, count), "a tile has no such template");
    require(point_into(begin, columns * (rows + 1), count + 1), "a tile begins outside of the templates");
    for (std::size_t column = 0; column < columns; ++column) {
      const std::int32_t* first = begin + column * (rows + 1);
      require(std::is_sorted(first, first + rows + 1), "the tiles do not ascend");
    }
  }

  // Rows, ascending, of the templates inside a sphere. position_m: (n, 3) of all.
  std::vector<std::int64_t> within(const float* position_m, const detail::Vector3& centre, double radius_m) const {
    return near<3>(position_m, centre, radius_m);
  }

  // Rows, ascending, of the templates at any height that are near a position on the level.
  std::vector<std::int64_t> near_on_level(const float* position_m, const detail::Vector3& centre, double radius_m) const {
    return near<2>(position_m, centre, radius_m);
  }

 private:
  template <std::size_t kAxes>
  std::vector<std::int64_t> near(const float* position_m, const detail::Vector3& centre, double radius_m) const {
    std::vector<std::int64_t> found;
    const auto [left, right] = bounds(centre[0], radius_m, low[0], columns);
    const auto [first, last] = bounds(centre[1], radius_m, low[1], rows);
    for (std::size_t column = left; column < right; ++column) {
      const std::int32_t* begins = begin + column * (rows + 1);
      for (std::int32_t i = begins[first]; i < begins[last]; ++i) {
        const float* position = position_m + 3 * static_cast<std::size_t>(row[i]);
        double away2 = 0;
        for (std::size_t axis = 0; axis < kAxes; ++axis) {
          const double away = static_cast<double>(position[axis]) - centre[axis];
          away2 += away * away;
        }
        if (std::sqrt(away2) <= radius_m) found.push_back(row[i]);
      }
    }
    std::sort(found.begin(), found.end());
    return found;
  }

  struct Bounds {
    std::size_t first, end;
  };

  // The tiles along an axis that are within reach, of `count`.
  static Bounds bounds(double at_m, double reach_m, std::int32_t lowest, std::size_t count) {
    const auto tile = [&](double edge_m, double beside) {
      const double number = std::floor(edge_m / kTileM) - lowest + beside;
      return number > 0 ? static_cast<std::size_t>(std::min(number, static_cast<double>(count))) : 0;
    };
    const std::size_t first = tile(at_m - reach_m, 0);
    return {first, std::max(first, tile(at_m + reach_m, 1))};
  }
};

}  // namespace firstfix
