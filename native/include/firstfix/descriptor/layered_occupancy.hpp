// The descriptor of a levelled scan: which cells of a layered polar grid are occupied. docs/method.md (3.1).
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix {

// Parameters of the descriptor: `engine.descriptor` of the map's manifest.
struct LayeredOccupancy {
  std::size_t rings = 20, sectors = 60;
  double max_range_m = 60;
  std::vector<double> layer_edges_m{0.3, 1.0, 1.8, 3.0, 6.0, 25.0};  // above the floor, ascending

  std::size_t layers() const { return layer_edges_m.empty() ? 0 : layer_edges_m.size() - 1; }
  std::size_t bits() const { return layers() * rings * sectors; }
  std::size_t bytes() const { return (bits() + 7) / 8; }
};

namespace detail {

inline bool usable(const LayeredOccupancy& d) {
  bool ok = d.rings >= 1 && d.rings <= 200 && d.sectors >= 1 && d.sectors <= 720 && d.layers() >= 1 &&
            d.layers() <= 16 && d.max_range_m > 0 && d.max_range_m <= 1000;
  for (std::size_t i = 0; ok && i < d.layer_edges_m.size(); ++i) {
    ok = std::fabs(d.layer_edges_m[i]) <= 1e6 && (i == 0 || d.layer_edges_m[i - 1] < d.layer_edges_m[i]);
  }
  return ok;
}

// Bits of the occupied cells of (count, 3) points that R brings to its levelled frame.
inline std::vector<std::uint8_t> occupancy(const float* points, std::size_t count, const Matrix3& R, float height_m,
                                           const LayeredOccupancy& d) {
  const std::vector<float> edges_m(d.layer_edges_m.begin(), d.layer_edges_m.end());
  const LayeredGrid grid = LayeredGrid::of(d.rings, d.sectors, d.max_range_m, edges_m);
  Rotation rotation;
  for (std::size_t i = 0; i < 9; ++i) rotation[i] = static_cast<float>(R[i / 3][i % 3]);
  const std::int64_t start[] = {0, static_cast<std::int64_t>(count)};
  std::vector<std::uint8_t> bits(grid.bytes());
  occupied_cells(points, start, &height_m, 1, &rotation, grid, bits.data());
  return bits;
}

}  // namespace detail
}  // namespace firstfix
