// The cells of a layered polar grid that hold points of a levelled scan: equal to firstfix.descriptor.occupied_cells to
// the last bit (docs/method.md, 3.1).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"

namespace firstfix {

// A polar grid in layers, with lengths as they are compared: in float.
struct LayeredGrid {
  std::size_t rings, sectors;
  float end_m, rings_a_metre;
  std::vector<float> edges_m;  // of the layers, ascending

  static LayeredGrid of(std::size_t rings, std::size_t sectors, double max_range_m, std::vector<float> edges_m) {
    const auto rings_a_metre = static_cast<float>(static_cast<double>(rings) / max_range_m);
    return {rings, sectors, static_cast<float>(max_range_m), rings_a_metre, std::move(edges_m)};
  }

  std::size_t layers() const { return edges_m.size() - 1; }
  std::size_t cells() const { return layers() * rings * sectors; }
  std::size_t bytes() const { return (cells() + 7) / 8; }
};

using Rotation = std::array<float, 9>;  // row by row

namespace detail {

constexpr std::size_t kPointsAtOnce = 512;

// Sets filled[cell] of each of (count, 3) points. Points outside the grid set filled[grid.cells()].
template <bool kTurn>
void fill_cells(const float* points, std::size_t count, const Rotation& R, float height_m, const LayeredGrid& grid,
                std::uint8_t* filled) {
  const auto layers = static_cast<std::int32_t>(grid.layers()), rings = static_cast<std::int32_t>(grid.rings),
             sectors = static_cast<std::int32_t>(grid.sectors), nowhere = static_cast<std::int32_t>(grid.cells());
  const auto last_ring = static_cast<float>(rings - 1), sectors_a_turn = static_cast<float>(sectors);
  const float end_m = grid.end_m, rings_a_metre = grid.rings_a_metre;
  float x[kPointsAtOnce], y[kPointsAtOnce], above[kPointsAtOnce];
  std::int32_t layer[kPointsAtOnce], cell[kPointsAtOnce];
  for (std::size_t start = 0; start < count; start += kPointsAtOnce) {
    const std::size_t n = std::min(kPointsAtOnce, count - start);
    const float* p = points + 3 * start;
    for (std::size_t i = 0; i < n; ++i) {
      const float px = p[3 * i], py = p[3 * i + 1], pz = p[3 * i + 2];
      x[i] = kTurn ? (px * R[0] + py * R[1]) + pz * R[2] : px;
      y[i] = kTurn ? (px * R[3] + py * R[4]) + pz * R[5] : py;
      above[i] = (kTurn ? (px * R[6] + py * R[7]) + pz * R[8] : pz) + height_m;
      layer[i] = -1;
    }
    for (const float edge : grid.edges_m) {
      for (std::size_t i = 0; i < n; ++i) layer[i] += above[i] >= edge ? 1 : 0;
    }
    for (std::size_t i = 0; i < n; ++i) {
      const float radius = std::sqrt(x[i] * x[i] + y[i] * y[i]);
      const bool inside = (radius < end_m) & (layer[i] >= 0) & (layer[i] < layers);  // false for NaN
      const auto ring = static_cast<std::int32_t>(std::min(last_ring, inside ? radius * rings_a_metre : 0.0F));
      const float turn = atan2_turns(inside ? y[i] : 0.0F, inside ? x[i] : 0.0F);
      auto sector = static_cast<std::int32_t>(std::floor(turn * sectors_a_turn));
      sector += sector < 0 ? sectors : 0;  // -0.5..0.5: the cell before 0 is the last
      sector = std::min(sector, sectors - 1);
      cell[i] = inside ? (layer[i] * rings + ring) * sectors + sector : nowhere;
    }
    for (std::size_t i = 0; i < n; ++i) filled[cell[i]] = 1;
  }
}

// Packs count bytes, each 0 or 1, into bits, the first in the most significant place.
inline void pack_bits(const std::uint8_t* filled, std::size_t count, std::uint8_t* bits) {
  for (std::size_t first = 0; first < count; first += 8) {
    unsigned byte = 0;
    for (std::size_t i = first; i < first + 8; ++i) byte = byte << 1 | (i < count ? filled[i] : 0U);
    bits[first / 8] = static_cast<std::uint8_t>(byte);
  }
}

}  // namespace detail

// Bits of the occupied cells of scans: layer by layer, ring by ring. Scan i has points[start[i]] to points[start[i + 1]]
// of (p, 3), its sensor stands at height_m[i]. R: rotates the points first; nullptr: they are levelled.
// bits: (scans, grid.bytes()).
inline void occupied_cells(const float* points, const std::int64_t* start, const float* height_m, std::size_t scans,
                           const Rotation* R, const LayeredGrid& grid, std::uint8_t* bits) {
  std::vector<std::uint8_t> filled(grid.cells() + 1);
  for (std::size_t i = 0; i < scans; ++i) {
    std::fill(filled.begin(), filled.end(), std::uint8_t{0});
    const float* first = points + 3 * start[i];
    const auto count = static_cast<std::size_t>(start[i + 1] - start[i]);
    if (R != nullptr) {
      detail::fill_cells<true>(first, count, *R, height_m[i], grid, filled.data());
    } else {
      detail::fill_cells<false>(first, count, {}, height_m[i], grid, filled.data());
    }
    detail::pack_bits(filled.data(), grid.cells(), bits + i * grid.bytes());
  }
}

}  // namespace firstfix
