#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "candidates.hpp"
#include "firstfix/query/template_places.hpp"
#include "places.hpp"
#include "rooms.hpp"

namespace firstfix::python {

void bind_places(nb::module_& module) {
  using namespace nb::literals;
  nb::class_<Places>(module, "TemplatePlaces")
      .def(nb::init<In<float, nb::shape<-1, 3>>, In<float, nb::ndim<1>>, In<std::int32_t, nb::ndim<1>>,
                    In<std::int32_t, nb::ndim<2>>, In<std::int32_t, nb::shape<2>>>(),
           "position_m"_a.noconvert(), "height_m"_a.noconvert(), "row"_a.noconvert(), "begin"_a.noconvert(),
           "low"_a.noconvert())
      .def(
          "stacked",
          [](const Places& places, PoseArray T_level_sensor) {
            return arrays_of(stacked_places(places.view, finite_pose_of(T_level_sensor)));
          },
          "T_level_sensor"_a);
  nb::class_<Aliases>(module, "AliasTable")
      .def(nb::init<In<std::int32_t, nb::ndim<2>>, In<std::uint8_t, nb::ndim<2>>, In<std::uint8_t, nb::ndim<2>>>(),
           "row"_a.noconvert(), "turn"_a.noconvert(), "score"_a.noconvert())
      .def(
          "of",
          [](const Aliases& aliases, Rows templates) {
            const std::vector<std::int64_t> rows(templates.data(), templates.data() + templates.shape(0));
            const auto known = static_cast<std::int64_t>(aliases.view.templates);
            require(std::all_of(rows.begin(), rows.end(), [&](auto row) { return 0 <= row && row < known; }),
                    "the row of a template is out of range");
            std::vector<std::int64_t> own, alias;
            std::vector<double> yaw_rad, score;
            for (const TemplateAlias& one : aliases.view.of(rows)) {
              own.push_back(one.own), alias.push_back(one.alias), yaw_rad.push_back(one.yaw_rad), score.push_back(one.score);
            }
            return std::make_tuple(array_of(std::move(own)), array_of(std::move(alias)), array_of(std::move(yaw_rad)),
                                   array_of(std::move(score)));
          },
          "templates"_a);
}

}  // namespace firstfix::python
