// The tables of a surface grid (firstfix.engine.registration.surface_grid): for any position the surface point near it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

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
#if defined(__AVX512F__)
    if (has_small_tables()) return gather(x, y, z, count, row);
#endif
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
#if defined(__AVX512F__)
  // Whether 31 bits number all entries of each table, as gathers need.
  bool has_small_tables() const {
    constexpr std::uint64_t kMost = std::uint64_t{1} << 31;
    const std::uint64_t level = static_cast<std::uint64_t>(shape[0]) * static_cast<std::uint64_t>(shape[1]);
    return level <= kMost && level * static_cast<std::uint64_t>(shape[2]) <= kMost &&
           std::uint64_t{groups} << 3 * side_bits <= kMost && std::uint64_t{blocks} << 3 * block_bits <= kMost;
  }

  static constexpr std::size_t kGathered = 16;
  using Int16 = std::int32_t __attribute__((vector_size(4 * kGathered)));
  using Unsigned16 = std::uint32_t __attribute__((vector_size(4 * kGathered)));

  // The entries of a table at sixteen places, and `instead` of those that do not point into a table of `limit` rows.
  static Int16 entries(const std::int32_t* table, const Int16& at, std::uint32_t limit, std::int32_t instead) {
    const Int16 found = reinterpret_cast<Int16>(
        _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), 0xFFFF, reinterpret_cast<__m512i>(at), table, 4));
    return reinterpret_cast<Unsigned16>(found) < limit ? found : Int16{} + instead;
  }

  static Int16 within(const Int16& x, const Int16& y, const Int16& z, int bits) {
    const std::int32_t mask = (1 << bits) - 1;
    return ((x & mask) << bits | (y & mask)) << bits | (z & mask);
  }

  // As `nearest`, sixteen cells at once: an entry that is in no cache keeps none of the others waiting.
  void gather(const std::int32_t* x, const std::int32_t* y, const std::int32_t* z, std::size_t count,
              std::int32_t* row) const {
    constexpr std::size_t kTogether = 16;
    const SurfaceGrid grid = *this;
    const int bits = grid.block_bits, side = grid.side_bits;
    Int16 at[kTogether], in_block[kTogether];
    for (std::size_t first = 0; first < count; first += kGathered * kTogether) {
      const std::size_t some = std::min(kGathered * kTogether, count - first), steps = (some + kGathered - 1) / kGathered;
      const auto lanes_of = [some](std::size_t k) {
        const std::size_t left = some - kGathered * k;
        return static_cast<__mmask16>(left >= kGathered ? 0xFFFFU : (1U << left) - 1);
      };
      for (std::size_t k = 0; k < steps; ++k) {
        const auto load = [&](const std::int32_t* from) {
          return reinterpret_cast<Int16>(_mm512_maskz_loadu_epi32(lanes_of(k), from + first + kGathered * k));
        };
        const Int16 cx = load(x), cy = load(y), cz = load(z), bx = cx >> bits, by = cy >> bits, bz = cz >> bits;
        const Int16 group = ((bx >> side) * grid.shape[1] + (by >> side)) * grid.shape[2] + (bz >> side);
        in_block[k] = within(cx, cy, cz, bits);
        at[k] = (entries(grid.group, group, grid.groups, 0) << 3 * side) + within(bx, by, bz, side);
      }
      for (std::size_t k = 0; k < steps; ++k) {
        at[k] = (entries(grid.block, at[k], grid.blocks, 0) << 3 * bits) + in_block[k];
      }
      for (std::size_t k = 0; k < steps; ++k) {
        const Int16 rows = entries(grid.point, at[k], grid.rows, -1);
        _mm512_mask_storeu_epi32(row + first + kGathered * k, lanes_of(k), reinterpret_cast<__m512i>(rows));
      }
    }
  }
#endif

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
