#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "firstfix/verification/carved_cells.hpp"
#include "firstfix/verification/free_space.hpp"
#include "firstfix/verification/map_view.hpp"
#include "firstfix/verification/seen_free.hpp"
#include "free_tables.hpp"
#include "grid.hpp"
#include "rooms.hpp"
#include "tiles.hpp"

namespace firstfix::python {

namespace {

using PoseArray = In<double, nb::shape<4, 4>>;
using Directions = nb::shape<static_cast<nb::ssize_t>(kDirections)>;

void require_cell(double cell_m) {
  require(cell_m >= 1e-6 && cell_m <= 1e6, "the edge of a cell is less than 1e-6 m, or over 1e6 m");
}

nb::ndarray<nb::numpy, std::int32_t> array_of_bits(const std::vector<BrickBits>& bits) {
  std::vector<std::int32_t> halves;
  halves.reserve(16 * bits.size());
  for (const BrickBits& brick : bits) {
    for (const std::uint64_t layer : brick) {
      halves.push_back(static_cast<std::int32_t>(static_cast<std::uint32_t>(layer)));
      halves.push_back(static_cast<std::int32_t>(static_cast<std::uint32_t>(layer >> 32)));
    }
  }
  return array_of(std::move(halves), {bits.size(), 8, 2});
}

std::vector<BrickBits> bits_of_array(const Bits& array) {
  std::vector<BrickBits> bits(array.shape(0));
  const std::int32_t* half = array.data();
  for (BrickBits& brick : bits) {
    for (std::uint64_t& layer : brick) {
      layer = static_cast<std::uint32_t>(half[0]) | static_cast<std::uint64_t>(static_cast<std::uint32_t>(half[1])) << 32;
      half += 2;
    }
  }
  return bits;
}

}  // namespace

void bind_verification(nb::module_& module) {
  nb::class_<Tiles>(module, "PointTiles")
      .def(nb::init<In<float, nb::shape<-1, 3>>, In<std::int32_t, nb::ndim<2>>, In<std::int32_t, nb::shape<2>>>(),
           nb::arg("points").noconvert(), nb::arg("begin").noconvert(), nb::arg("low").noconvert())
      .def(
          "nearest_by_direction",
          [](const Tiles& tiles, PoseArray T_map_sensor, double reach_m) {
            std::vector<float> nearest(kDirections, std::numeric_limits<float>::infinity());
            without_gil([&] { MapView(pose_of(T_map_sensor), RowBand{}, nearest.data()).draw(tiles.view, reach_m); });
            return array_of(std::move(nearest), {kDirections});
          },
          nb::arg("T_map_sensor"), nb::arg("reach_m"));
  module.def(
      "seen_through",
      [](const Tiles& near, const Tiles& far, double reach_m, const Grid& surface, In<bool, Directions> returned,
         In<float, Directions> least, PoseArray T_map_sensor) {
        const auto* is_returned = reinterpret_cast<const std::uint8_t*>(returned.data());
        const SeenThrough found = without_gil([&] {
          return seen_through(near.view, far.view, reach_m, surface.view, is_returned, least.data(),
                              pose_of(T_map_sensor));
        });
        return std::make_tuple(found.onto_nothing, found.onto_surface);
      },
      nb::arg("near"), nb::arg("far"), nb::arg("reach_m"), nb::arg("surface"), nb::arg("returned"), nb::arg("least"),
      nb::arg("T_map_sensor"));
  nb::class_<CarvedCells>(module, "CarvedCells")
      .def("__init__",
           [](CarvedCells* place, double cell_m) {
             require_cell(cell_m);
             new (place) CarvedCells(cell_m);
           },
           nb::arg("cell_m"))
      .def(
          "add",
          [](CarvedCells& cells, In<double, nb::shape<-1, 3>> origins, In<float, nb::shape<-1, 3>> directions,
             In<float, nb::shape<-1, -1>> ranges, double back_off_m) {
            const std::size_t number = origins.shape(0), count = directions.shape(0);
            require(ranges.shape(0) == number && ranges.shape(1) == count, "ranges have a row for each origin");
            require(back_off_m >= 0, "back_off_m is negative");
            without_gil([&] {
              for (std::size_t i = 0; i < number; ++i) {
                cells.add(origins.data() + 3 * i, directions.data(), count, ranges.data() + count * i, back_off_m);
              }
            });
          },
          nb::arg("origins"), nb::arg("directions"), nb::arg("ranges"), nb::arg("back_off_m"))
      .def("bricks", [](CarvedCells& cells) {
        CarvedBricks found = without_gil([&] { return cells.bricks(); });
        const std::size_t count = found.once.size();
        return std::make_tuple(array_of(std::move(found.brick), {count, 3}), array_of_bits(found.once),
                               array_of_bits(found.twice));
      });
  module.def(
      "take_out_near",
      [](In<std::int32_t, nb::shape<-1, 3>> brick, Bits bits, In<double, nb::shape<-1, 3>> points, double cell_m) {
        require_cell(cell_m);
        require(brick.shape(0) == bits.shape(0), "there is not one brick for each row of bits");
        constexpr std::int32_t kMost = 1 << 17;  // cells have numbers of 21 bits
        require(std::all_of(brick.data(), brick.data() + brick.size(), [](std::int32_t b) { return b >= -kMost && b < kMost; }),
                "a brick is too far from the origin");
        std::vector<BrickBits> left = bits_of_array(bits);
        without_gil([&] {
          take_out_near(brick.data(), brick.shape(0), points.data(), points.shape(0), cell_m, left.data());
        });
        return array_of_bits(left);
      },
      nb::arg("brick"), nb::arg("bits"), nb::arg("points"), nb::arg("cell_m"));
  nb::class_<FreeTables>(module, "SeenFree")
      .def(nb::init<float, In<float, nb::shape<3>>, In<std::int32_t, nb::ndim<3>>, In<std::int32_t, nb::shape<-1, 8, 8, 8>>,
                    Bits>(),
           nb::arg("cell_m"), nb::arg("corner").noconvert(), nb::arg("group").noconvert(), nb::arg("brick").noconvert(),
           nb::arg("bits").noconvert())
      .def(
          "shares",
          [](const FreeTables& free, In<float, nb::shape<-1, 3>> points, In<double, nb::shape<-1, 4, 4>> T_level_sensor) {
            const std::vector<PoseMatrix> T = poses_of(T_level_sensor);
            std::vector<double> shares(T.size());
            without_gil([&] {
              for (std::size_t i = 0; i < T.size(); ++i) {
                shares[i] = free.view.share(points.data(), points.shape(0), T[i]);
              }
            });
            return array_of(std::move(shares));
          },
          nb::arg("points"), nb::arg("T_level_sensor"))
      .def(
          "holds",
          [](const FreeTables& free, In<float, nb::shape<-1, 3>> points, PoseArray T_level_sensor) {
            std::unique_ptr<bool[]> flags = memory<bool>(points.shape(0));
            static_assert(sizeof(bool) == sizeof(std::uint8_t));
            without_gil([&] {
              free.view.holds(points.data(), points.shape(0), pose_of(T_level_sensor),
                              reinterpret_cast<std::uint8_t*>(flags.get()));
            });
            return array_of(std::move(flags), {points.shape(0)});
          },
          nb::arg("points"), nb::arg("T_level_sensor"));
}

}  // namespace firstfix::python
