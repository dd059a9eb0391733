// The tables of cells that were seen free, as kernels of several rooms take them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "arrays.hpp"
#include "firstfix/verification/seen_free.hpp"
#include "grid.hpp"

namespace firstfix::python {

using Bits = In<std::int32_t, nb::shape<-1, 8, 2>>;  // the halves of 64 bits, the lower one first

// The tables of cells that were seen free, kept as long as a kernel may read them. Their contents are not read here: a
// large map's file is mapped, and loading it must stay quick.
class FreeTables {
 public:
  FreeTables(float cell_m, In<float, nb::shape<3>> corner, In<std::int32_t, nb::ndim<3>> group,
             In<std::int32_t, nb::shape<-1, 8, 8, 8>> brick, Bits bits)
      : group_(group), brick_(brick), bits_(bits) {
    require(cell_m > 0 && cell_m < 1e6F, "the width of a cell must be positive");
    require(brick.shape(0) > 0 && bits.shape(0) > 0, "a table is empty");
    view.cell_m = cell_m;
    view.group = group.data();
    view.brick = brick.data();
    view.groups = count_of(brick.shape(0));
    view.bits = bits.data();
    view.bricks = count_of(bits.shape(0));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      view.corner_m[axis] = corner.data()[axis];
      require(group.shape(axis) > 0 && group.shape(axis) <= static_cast<std::size_t>(SeenFree::kMostGroups),
              "the table of groups is empty or too large");
      view.shape[axis] = static_cast<std::int32_t>(group.shape(axis));
    }
  }

  SeenFree view{};

 private:
  In<std::int32_t, nb::ndim<3>> group_;
  In<std::int32_t, nb::shape<-1, 8, 8, 8>> brick_;
  Bits bits_;
};

}  // namespace firstfix::python
