// Which of a placed scan's points lie where the mapping run saw nothing, and their share (docs/method.md section 7).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

// Cells that were seen free (firstfix.engine.verification.seen_free): a bit each, in bricks of 8 x 8 x 8 cells, which lie in
// groups of 8 x 8 x 8 bricks. The tables usually lie in a mapped file, and nobody has read them: a damaged one may hold any
// number. So every number is compared with the size of the table that it points into.
struct SeenFree {
  float cell_m;
  float corner_m[3];
  const std::int32_t* group;
  std::int32_t shape[3];      // of `group`, each at least 1
  const std::int32_t* brick;  // (groups, 8, 8, 8)
  std::uint32_t groups;       // at least 1
  const std::int32_t* bits;   // (bricks, 8, 2)
  std::uint32_t bricks;       // at least 1

  static constexpr std::int32_t kMostGroups = 1 << 18;  // along an axis: float counts the cells exactly

  // Share of (count, 3) points that lie in such cells; 0 of none.
  double share(const float* points, std::size_t count, const PoseMatrix& T_level_sensor) const {
    const FloatPose pose(T_level_sensor, corner_m);
    const float per_m = 1 / cell_m;
    std::size_t inside = 0;
    std::int32_t cell[3][kAtOnce], row[kAtOnce];
    for (std::size_t first = 0; first < count; first += kAtOnce) {
      const std::size_t some = std::min(kAtOnce, count - first);
      std::size_t within_grid = 0;
      for (std::size_t i = 0; i < some; ++i) {
        within_grid += set_cell(points + 3 * (first + i), pose, per_m, cell, within_grid);  // else the next one takes its place
      }
      inside += free_cells(cell, within_grid, row);
    }
    return count == 0 ? 0 : static_cast<double>(inside) / static_cast<double>(count);
  }

  // Sets for each of (count, 3) points whether it lies in such a cell.
  void holds(const float* points, std::size_t count, const PoseMatrix& T_level_sensor, std::uint8_t* is_free) const {
    const FloatPose pose(T_level_sensor, corner_m);
    const float per_m = 1 / cell_m;
    std::int32_t cell[3][kAtOnce], row[kAtOnce];
    for (std::size_t i = 0; i < count; ++i) {
      is_free[i] = set_cell(points + 3 * i, pose, per_m, cell, 0) && free_cells(cell, 1, row) == 1;
    }
  }

 private:
  static constexpr std::size_t kAtOnce = 256;

  // Sets the cell of a point at a place of the arrays. Returns whether it lies within the grid.
  bool set_cell(const float* p, const FloatPose& pose, float per_m, std::int32_t (&cell)[3][kAtOnce], std::size_t place) const {
    bool is_within = true;
    for (int axis = 0; axis < 3; ++axis) {
      const float* R = pose.R + 3 * axis;
      const float scaled = (R[0] * p[0] + R[1] * p[1] + R[2] * p[2] + pose.t[axis]) * per_m;
      const bool on_axis = scaled >= 0 && scaled < static_cast<float>(shape[axis] << 6);
      is_within &= on_axis;
      cell[axis][place] = on_axis ? static_cast<std::int32_t>(scaled) : 0;
    }
    return is_within;
  }

  // Number of the free ones among cells within the grid. Each table is read for all before the next one: the reads do not
  // wait for each other.
  std::size_t free_cells(const std::int32_t (&cell)[3][kAtOnce], std::size_t count, std::int32_t (&row)[kAtOnce]) const {
    const std::int32_t *x = cell[0], *y = cell[1], *z = cell[2];
    for (std::size_t i = 0; i < count; ++i) {
      const std::int64_t column = static_cast<std::int64_t>(x[i] >> 6) * shape[1] + (y[i] >> 6);
      row[i] = group[column * shape[2] + (z[i] >> 6)];
    }
    for (std::size_t i = 0; i < count; ++i) {
      row[i] = brick[kept(row[i], groups) << 9 | within(x[i] >> 3, y[i] >> 3, z[i] >> 3)];
    }
    std::size_t free = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t in_brick = within(x[i], y[i], z[i]);
      free += static_cast<std::uint32_t>(bits[kept(row[i], bricks) << 4 | in_brick >> 5]) >> (in_brick & 31) & 1;
    }
    return free;
  }

  static std::size_t kept(std::int32_t number, std::uint32_t count) {
    const auto unsigned_number = static_cast<std::uint32_t>(number);
    return unsigned_number < count ? unsigned_number : 0;
  }

  // The number of a part in its cube of eight parts a side.
  static std::size_t within(std::int32_t x, std::int32_t y, std::int32_t z) {
    return static_cast<std::size_t>((x & 7) << 6 | (y & 7) << 3 | (z & 7));
  }
};

}  // namespace firstfix
