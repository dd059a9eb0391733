// Which points of a cloud have others near them: what stands alone is no surface.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace firstfix {

// kept[i]: points[i] has at least `least` others less than radius_m away. Points are (count, 3) and finite. Throws
// std::invalid_argument where they lie over two million radii apart.
inline void with_neighbours(const double* points, std::size_t count, double radius_m, std::size_t least,
                            std::uint8_t* kept) {
  constexpr unsigned kBits = 21;
  constexpr double kMost = (1 << kBits) - 2;  // cells along an axis: one beside each end stays empty
  struct Item {
    std::int64_t cell;  // x, y, z of kBits, so that a row of cells along z stands together
    double at[3];
    std::size_t row;
  };
  std::vector<Item> items(count);
  double low[3] = {INFINITY, INFINITY, INFINITY};
  for (std::size_t i = 0; i < 3 * count; ++i) low[i % 3] = std::min(low[i % 3], points[i]);
  for (std::size_t i = 0; i < count; ++i) {
    Item& item = items[i];
    item = {0, {}, i};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      item.at[axis] = points[3 * i + axis];
      const double cell = std::floor((item.at[axis] - low[axis]) / radius_m);
      if (!(cell < kMost)) throw std::invalid_argument("points are too far apart for such a radius");
      item.cell = item.cell << kBits | (1 + static_cast<std::int64_t>(cell));
    }
  }
  std::sort(items.begin(), items.end(), [](const Item& a, const Item& b) { return a.cell < b.cell; });
  // The nine rows of three cells around the cell at hand. They only move on, as the cells ascend.
  constexpr std::size_t kRows = 9;
  std::int64_t shift[kRows];
  std::size_t begin[kRows] = {}, end[kRows] = {};
  for (std::size_t row = 0; row < kRows; ++row) {
    const std::size_t at = (row + kRows / 2) % kRows;  // the middle one first: most neighbours are there
    const auto x = static_cast<std::int64_t>(at / 3) - 1, y = static_cast<std::int64_t>(at % 3) - 1;
    shift[row] = ((x * (std::int64_t{1} << kBits)) + y) * (std::int64_t{1} << kBits);
  }
  for (std::size_t first = 0; first < count;) {
    const std::int64_t cell = items[first].cell;
    std::size_t last = first;
    while (last < count && items[last].cell == cell) ++last;
    for (std::size_t row = 0; row < kRows; ++row) {
      const std::int64_t middle = cell + shift[row];
      while (begin[row] < count && items[begin[row]].cell < middle - 1) ++begin[row];
      end[row] = std::max(end[row], begin[row]);
      while (end[row] < count && items[end[row]].cell <= middle + 1) ++end[row];
    }
    for (; first < last; ++first) {
      const double* own = items[first].at;
      std::size_t near = 0;  // with the point itself
      for (std::size_t row = 0; row < kRows && near <= least; ++row) {
        for (std::size_t other = begin[row]; other < end[row] && near <= least; ++other) {
          const double* at = items[other].at;
          const double x = at[0] - own[0], y = at[1] - own[1], z = at[2] - own[2];
          near += x * x + y * y + z * z < radius_m * radius_m;
        }
      }
      kept[items[first].row] = near > least;
    }
  }
}

}  // namespace firstfix
