#include "arrays.hpp"
#include "firstfix/retrieval/spread_out.hpp"
#include "rooms.hpp"

namespace firstfix::python {

void bind_retrieval(nb::module_& module) {
  module.def(
      "spread_out",
      [](In<double, nb::shape<-1, 3>> position_m, In<double, nb::shape<-1>> yaw_rad, std::size_t at_most, double spot_m,
         double spot_cosine, std::size_t at_most_a_spot) {
        const std::size_t count = position_m.shape(0);
        require(yaw_rad.shape(0) == count, "a pose has one position and one yaw");
        return array_of(without_gil([&] {
          return spread_out(position_m.data(), yaw_rad.data(), count, at_most, {spot_m, spot_cosine, at_most_a_spot});
        }));
      },
      nb::arg("position_m"), nb::arg("yaw_rad"), nb::arg("at_most"), nb::arg("spot_m"), nb::arg("spot_cosine"),
      nb::arg("at_most_a_spot"));
}

}  // namespace firstfix::python
