// The tables of map points in tiles, as kernels of several rooms take them.
#pragma once

#include <cstdint>

#include "arrays.hpp"
#include "firstfix/verification/point_tiles.hpp"

namespace firstfix::python {

// The tables of tiles, kept as long as a kernel may read them. Their contents are not read here: a large map's file is
// mapped, and loading it must stay quick.
class Tiles {
 public:
  Tiles(In<float, nb::shape<-1, 3>> points, In<std::int32_t, nb::ndim<2>> begin, In<std::int32_t, nb::shape<2>> low)
      : points_(points), begin_(begin) {
    require(begin.shape(1) > 0, "the table of tiles has no column");
    require(begin.shape(0) < (1U << 31) && begin.shape(1) < (1U << 31), "the table of tiles is too large");
    view = {points.data(), static_cast<std::int64_t>(points.shape(0)), begin.data(),
            static_cast<std::int64_t>(begin.shape(0)), static_cast<std::int64_t>(begin.shape(1)) - 1,
            {low.data()[0], low.data()[1]}};
  }

  PointTiles view{};

 private:
  In<float, nb::shape<-1, 3>> points_;
  In<std::int32_t, nb::ndim<2>> begin_;
};

}  // namespace firstfix::python
