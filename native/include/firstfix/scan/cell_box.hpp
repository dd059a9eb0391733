// Cells of a grid, and their numbers within a box.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firstfix::detail {

using Cell = std::array<std::int64_t, 3>;

struct CellBox {
  Cell lowest{}, size{1, 1, 1};

  static CellBox around(const std::vector<Cell>& cells) {
    CellBox box;
    if (cells.empty()) return box;
    Cell highest = box.lowest = cells.front();
    for (const Cell& cell : cells) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.lowest[axis] = std::min(box.lowest[axis], cell[axis]);
        highest[axis] = std::max(highest[axis], cell[axis]);
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) box.size[axis] = highest[axis] - box.lowest[axis] + 1;
    return box;
  }

  // Numbers a cell: z is the slowest index, x the fastest.
  std::int64_t number(const Cell& cell) const {
    return ((cell[2] - lowest[2]) * size[1] + (cell[1] - lowest[1])) * size[0] + (cell[0] - lowest[0]);
  }
};

}  // namespace firstfix::detail
