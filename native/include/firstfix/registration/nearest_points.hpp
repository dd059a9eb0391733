// Builds the last table of a surface grid: the point nearest to each cell's centre, among those in and around the cell.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace firstfix {

// Some blocks of a grid, and the tables that lead to them.
struct GridBlocks {
  const std::int32_t* group;
  std::int64_t shape[3];  // of `group`
  const std::int32_t* block;
  std::int64_t groups;  // kept ones
  int side_bits, block_bits;
  std::int64_t first, count;  // the blocks that are filled
};

// Rows of the points nearest to the cells' centres, (blocks, s, s, s), -1 where there is none. A point counts for its own
// cell and the 26 around it. Of equally near ones, to a millionth of a cell's area, the least row counts.
//
// cell, offset: (count, 3) the cell of each point, and where in it the point lies, 0..1. row: (count,) its number.
inline std::vector<std::int32_t> nearest_points(const GridBlocks& grid, const std::int32_t* cell, const float* offset,
                                                const std::int32_t* row, std::size_t count) {
  constexpr std::int64_t kNothing = std::numeric_limits<std::int64_t>::max();
  constexpr float kParts = 1 << 20;
  const int group_bits = grid.side_bits + grid.block_bits;
  const std::int64_t side_mask = (1 << grid.side_bits) - 1, cell_mask = (1 << grid.block_bits) - 1;
  const auto within = [](std::int64_t x, std::int64_t y, std::int64_t z, int bits, std::int64_t mask) {
    return ((((x & mask) << bits) | (y & mask)) << bits) | (z & mask);
  };
  std::vector<std::int64_t> best(static_cast<std::size_t>(grid.count) << 3 * grid.block_bits, kNothing);
  for (std::size_t i = 0; i < count; ++i) {
    float away2[3][3];  // of each axis and step
    for (int axis = 0; axis < 3; ++axis) {
      for (int step = 0; step < 3; ++step) {
        const float away = offset[3 * i + axis] - static_cast<float>(step - 1) - 0.5F;
        away2[axis][step] = away * away;
      }
    }
    for (int at = 0; at < 27; ++at) {
      const int steps[3] = {at / 9, at / 3 % 3, at % 3};
      std::int64_t c[3];
      bool is_inside = true;
      for (int axis = 0; axis < 3; ++axis) {
        c[axis] = static_cast<std::int64_t>(cell[3 * i + axis]) + steps[axis] - 1;
        is_inside = is_inside && c[axis] >= 0 && c[axis] >> group_bits < grid.shape[axis];
      }
      if (!is_inside) continue;
      const std::int64_t column = (c[0] >> group_bits) * grid.shape[1] + (c[1] >> group_bits);
      const std::int64_t group = grid.group[column * grid.shape[2] + (c[2] >> group_bits)];
      if (group < 0 || group >= grid.groups) continue;
      const std::int64_t block =
          grid.block[(group << 3 * grid.side_bits) + within(c[0] >> grid.block_bits, c[1] >> grid.block_bits,
                                                            c[2] >> grid.block_bits, grid.side_bits, side_mask)] -
          grid.first;
      if (block < 0 || block >= grid.count) continue;
      const float distance2 = away2[0][steps[0]] + away2[1][steps[1]] + away2[2][steps[2]];
      const std::int64_t entry = static_cast<std::int64_t>(distance2 * kParts) << 32 | row[i];
      std::int64_t& here = best[static_cast<std::size_t>((block << 3 * grid.block_bits) +
                                                         within(c[0], c[1], c[2], grid.block_bits, cell_mask))];
      if (entry < here) here = entry;
    }
  }
  std::vector<std::int32_t> point(best.size());
  for (std::size_t i = 0; i < best.size(); ++i) {
    point[i] = best[i] == kNothing ? -1 : static_cast<std::int32_t>(best[i] & 0x7FFFFFFF);
  }
  return point;
}

}  // namespace firstfix
