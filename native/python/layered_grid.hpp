// The layered polar grid of a descriptor, as kernels of several rooms take it.
#pragma once

#include <cmath>
#include <cstddef>

#include "arrays.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"

namespace firstfix::python {

using Edges = In<float, nb::shape<-1>>;

inline constexpr std::size_t kMaxRings = 1000, kMaxSectors = 3600, kMaxCells = 1 << 24;  // a float counts so many exactly

inline void require_grid(std::size_t rings, std::size_t sectors) {
  require(rings >= 1 && sectors >= 1 && sectors <= kMaxSectors && rings <= kMaxCells / sectors,
          "the grid has too few or too many cells");
}

inline LayeredGrid grid_of(std::size_t rings, std::size_t sectors, double max_range_m, const Edges& edges_m) {
  const std::size_t edges = edges_m.shape(0);
  require(rings <= kMaxRings && max_range_m > 0, "the grid's rings or its range are out of range");
  require(edges >= 2 && edges <= kMaxCells, "a grid has at least one layer");
  for (std::size_t i = 0; i < edges; ++i) {
    require(!std::isnan(edges_m.data()[i]) && (i == 0 || edges_m.data()[i - 1] <= edges_m.data()[i]),
            "the edges of the layers do not ascend");
  }
  require_grid((edges - 1) * rings, sectors);
  return LayeredGrid::of(rings, sectors, max_range_m, {edges_m.data(), edges_m.data() + edges});
}

}  // namespace firstfix::python
