// The tables of a surface grid (firstfix.engine.registration.surface_grid): for any position the surface point near it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firstfix {

// Plane of a surface point: its normal, and its distance along the normal from the grid's corner.
struct Plane {
  float nx, ny, nz, off_m;
};

// The tables usually lie in a mapped file, and nobody has read them: a damaged one may hold any number. So every number
// is compared with the size of the table that it points into.
struct SurfaceGrid {
  float cell_m;
  float corner_m[3];
  const Plane* planes;
  const std::uint8_t* oriented;
  const std::int32_t* other_face;  // of each plane, the nearest that faces the other way
  std::uint32_t rows;              // at least 1
  const std::int32_t* group;
  std::int32_t shape[3];  // of `group`, each at least 1
  const std::int32_t* block;
  std::uint32_t groups;  // kept ones, at least 1
  const std::int32_t* point;
  std::uint32_t blocks;  // kept ones, at least 1
  int side_bits, block_bits;

  static constexpr std::int32_t kMostCells = 1 << 24;  // along an axis: float counts them exactly

  // The last cell along an axis.
  float last(int axis) const { return static_cast<float>((shape[axis] << (side_bits + block_bits)) - 1); }

  // The surface points near cells, -1 where there is none. The cells lie between 0 and `last` on every axis. Each table is
  // read for all cells before the next one, whose entries are asked for at once: they come from far memory all together.
  void nearest(const std::int32_t* x, const std::int32_t* y, const std::int32_t* z, std::size_t count,
               std::int32_t* row) const {
    constexpr std::size_t kAtOnce = 256;
    const SurfaceGrid grid = *this;  // else the compiler reads it anew after each write of a row, which might be part of it
    const int group_bits = grid.side_bits + grid.block_bits;
    std::int32_t in_group[kAtOnce], in_block[kAtOnce];
    std::size_t at[kAtOnce];
    for (std::size_t first = 0; first < count; first += kAtOnce, x += kAtOnce, y += kAtOnce, z += kAtOnce, row += kAtOnce) {
      const std::size_t some = std::min(kAtOnce, count - first);
      for (std::size_t i = 0; i < some; ++i) {
        const std::int32_t bits = grid.block_bits;
        in_group[i] = within(x[i] >> bits, y[i] >> bits, z[i] >> bits, grid.side_bits);
        in_block[i] = within(x[i], y[i], z[i], bits);
      }
      for (std::size_t i = 0; i < some; ++i) {
        const std::int64_t column = static_cast<std::int64_t>(x[i] >> group_bits) * grid.shape[1] + (y[i] >> group_bits);
        const std::int32_t found = grid.group[column * grid.shape[2] + (z[i] >> group_bits)];
        at[i] = (kept(found, grid.groups) << 3 * grid.side_bits) + static_cast<std::size_t>(in_group[i]);
        __builtin_prefetch(grid.block + at[i]);
      }
      for (std::size_t i = 0; i < some; ++i) {
        at[i] = (kept(grid.block[at[i]], grid.blocks) << 3 * grid.block_bits) + static_cast<std::size_t>(in_block[i]);
        __builtin_prefetch(grid.point + at[i]);
      }
      for (std::size_t i = 0; i < some; ++i) {
        const std::int32_t found = grid.point[at[i]];
        row[i] = static_cast<std::uint32_t>(found) < grid.rows ? found : -1;
      }
    }
  }

 private:
  static std::size_t kept(std::int32_t number, std::uint32_t count) {
    const auto unsigned_number = static_cast<std::uint32_t>(number);
    return unsigned_number < count ? unsigned_number : 0;
  }

  // The number of a cell in its cube of 2^bits cells a side.
  static std::int32_t within(std::int32_t x, std::int32_t y, std::int32_t z, int bits) {
    const std::int32_t mask = (1 << bits) - 1;
    return ((x & mask) << bits | (y & mask)) << bits | (z & mask);
  }
};

// A coordinate's cell: 0 below the grid, `last` above. What is not a number lies in cell 0.
inline std::int32_t cell_at(float scaled, float last) {
  const float from_zero = scaled > 0.0F ? scaled : 0.0F;
  return static_cast<std::int32_t>(from_zero < last ? from_zero : last);
}

// Number of positions, x y z x y z relative to the grid's corner, whose cell has a surface point. Outside of the grid none has.
inline std::size_t near_surface(const SurfaceGrid& grid, const std::vector<float>& positions) {
  const float per_m = 1 / grid.cell_m;
  std::vector<std::int32_t> cell[3];
  for (std::size_t i = 0; i < positions.size(); i += 3) {
    bool is_inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      const float scaled = positions[i + axis] * per_m;
      is_inside = is_inside && scaled >= 0 && scaled < grid.last(axis) + 1;
    }
    if (!is_inside) continue;
    for (int axis = 0; axis < 3; ++axis) cell[axis].push_back(cell_at(positions[i + axis] * per_m, grid.last(axis)));
  }
  std::vector<std::int32_t> row(cell[0].size());
  grid.nearest(cell[0].data(), cell[1].data(), cell[2].data(), row.size(), row.data());
  return row.size() - static_cast<std::size_t>(std::count(row.begin(), row.end(), -1));
}

}  // namespace firstfix
