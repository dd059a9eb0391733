#include <nanobind/stl/tuple.h>

#include <limits>
#include <tuple>

#include "arrays.hpp"
#include "firstfix/verification/free_space.hpp"
#include "firstfix/verification/map_view.hpp"
#include "grid.hpp"
#include "rooms.hpp"
#include "tiles.hpp"

namespace firstfix::python {

namespace {

using PoseArray = In<double, nb::shape<4, 4>>;
using Directions = nb::shape<static_cast<nb::ssize_t>(kDirections)>;

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
}

}  // namespace firstfix::python
