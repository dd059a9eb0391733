// The descriptor of a levelled scan: which cells of a layered polar grid are occupied. docs/method.md (3.1).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/portable/atan2.hpp"
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

// Bits of the occupied cells: layer by layer, ring by ring, most significant bit first.
inline std::vector<std::uint8_t> occupancy(const std::vector<Point>& levelled, float height_m,
                                           const LayeredOccupancy& grid) {
  const std::vector<float> edges(grid.layer_edges_m.begin(), grid.layer_edges_m.end());
  const auto end_m = static_cast<float>(grid.max_range_m);
  const auto rings_a_metre = static_cast<float>(static_cast<double>(grid.rings) / grid.max_range_m);
  const auto sectors = static_cast<std::ptrdiff_t>(grid.sectors);
  std::vector<std::uint8_t> bits(grid.bytes());
  for (const Point& p : levelled) {
    const auto edge = std::upper_bound(edges.begin(), edges.end(), p.z + height_m);
    if (edge == edges.begin() || edge == edges.end()) continue;
    const float radius = std::sqrt(p.x * p.x + p.y * p.y);
    if (!(radius < end_m)) continue;
    const auto layer = static_cast<std::size_t>(edge - edges.begin()) - 1;
    const std::size_t ring = std::min(static_cast<std::size_t>(radius * rings_a_metre), grid.rings - 1);
    auto sector = static_cast<std::ptrdiff_t>(std::floor(atan2_turns(p.y, p.x) * static_cast<float>(sectors)));
    sector = std::min(sector < 0 ? sector + sectors : sector, sectors - 1);
    const std::size_t bit = (layer * grid.rings + ring) * grid.sectors + static_cast<std::size_t>(sector);
    bits[bit / 8] = static_cast<std::uint8_t>(bits[bit / 8] | (0x80U >> (bit % 8)));
  }
  return bits;
}

}  // namespace detail
}  // namespace firstfix
