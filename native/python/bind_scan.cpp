#include "arrays.hpp"
#include "firstfix/scan/voxel_filter.hpp"
#include "rooms.hpp"

namespace firstfix::python {

void bind_scan(nb::module_& module) {
  module.def(
      "within_range",
      [](In<float, nb::shape<-1, 3>> points, double min_range_m, double max_range_m) {
        const std::size_t count = points.shape(0);
        std::vector<float> kept;
        {
          nb::gil_scoped_release release;
          kept.resize(3 * count);
          kept.resize(3 * within_range(points.data(), count, min_range_m, max_range_m, kept.data()));
        }
        const std::size_t left = kept.size() / 3;
        return array_of(std::move(kept), {left, 3});
      },
      nb::arg("points"), nb::arg("min_range_m"), nb::arg("max_range_m"));
}

}  // namespace firstfix::python
