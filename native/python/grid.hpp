// The tables of a surface grid, as kernels of several rooms take them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "arrays.hpp"
#include "firstfix/registration/surface_grid.hpp"

namespace firstfix::python {

using Flags = In<bool, nb::ndim<1>>;
using Cubes = In<std::int32_t, nb::ndim<4>>;

inline const std::uint8_t* bytes_of(const Flags& flags) { return reinterpret_cast<const std::uint8_t*>(flags.data()); }

// The width of cubes, as a power of two.
inline int bits_of(const Cubes& cubes) {
  int bits = 0;
  while (bits < 8 && (std::size_t{1} << bits) < cubes.shape(1)) ++bits;
  const std::size_t side = std::size_t{1} << bits;
  require(cubes.shape(1) == side && cubes.shape(2) == side && cubes.shape(3) == side,
          "the blocks are no cubes of a power of two");
  return bits;
}

inline std::uint32_t count_of(std::size_t rows) {
  require(rows <= static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()), "a table has too many rows");
  return static_cast<std::uint32_t>(rows);
}

// The tables of a grid, kept as long as a kernel may read them. Their contents are not read here: a large map's file is
// mapped, and loading it must stay quick.
class Grid {
 public:
  Grid(float cell_m, In<float, nb::shape<3>> corner, In<float, nb::shape<-1, 4>> planes, Flags oriented,
       In<std::int32_t, nb::ndim<1>> other_face, In<std::int32_t, nb::ndim<3>> group, Cubes block, Cubes point)
      : planes_(planes), oriented_(oriented), other_face_(other_face), group_(group), block_(block), point_(point) {
    require(cell_m > 0 && cell_m < 1e6F, "the width of a cell must be positive");
    require(oriented.shape(0) == planes.shape(0) && other_face.shape(0) == planes.shape(0),
            "planes, oriented and other_face differ in length");
    require(planes.shape(0) > 0 && block.shape(0) > 0 && point.shape(0) > 0, "a table is empty");
    view.cell_m = cell_m;
    for (int axis = 0; axis < 3; ++axis) view.corner_m[axis] = corner.data()[axis];
    view.planes = reinterpret_cast<const Plane*>(planes.data());
    view.oriented = bytes_of(oriented);
    view.other_face = other_face.data();
    view.rows = count_of(planes.shape(0));
    view.group = group.data();
    view.block = block.data();
    view.groups = count_of(block.shape(0));
    view.point = point.data();
    view.blocks = count_of(point.shape(0));
    view.side_bits = bits_of(block);
    view.block_bits = bits_of(point);
    const std::size_t most = static_cast<std::size_t>(SurfaceGrid::kMostCells) >> (view.side_bits + view.block_bits);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      require(group.shape(axis) > 0 && group.shape(axis) <= most, "the grid is empty or too large");
      view.shape[axis] = static_cast<std::int32_t>(group.shape(axis));
    }
  }

  SurfaceGrid view{};

 private:
  In<float, nb::shape<-1, 4>> planes_;
  Flags oriented_;
  In<std::int32_t, nb::ndim<1>> other_face_;
  In<std::int32_t, nb::ndim<3>> group_;
  Cubes block_, point_;
};

}  // namespace firstfix::python
