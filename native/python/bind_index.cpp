#include "arrays.hpp"
#include "firstfix/index/column_means.hpp"
#include "firstfix/index/seen_surface.hpp"
#include "rooms.hpp"

namespace firstfix::python {

void bind_index(nb::module_& module) {
  nb::class_<SeenSurface>(module, "SeenSurface")
      .def("__init__",
           [](SeenSurface* place, double voxel_m) {
             require(voxel_m > 0, "a voxel has a size");
             new (place) SeenSurface(voxel_m);
           },
           nb::arg("voxel_m"))
      .def(
          "add",
          [](SeenSurface& surface, In<float, nb::shape<-1, 3>> origins, In<float, nb::shape<-1, 3>> directions,
             In<float, nb::shape<-1, -1>> ranges) {
            const std::size_t number = origins.shape(0), count = directions.shape(0);
            require(ranges.shape(0) == number && ranges.shape(1) == count, "ranges have a row for each origin");
            without_gil([&] { surface.add(origins.data(), number, directions.data(), count, ranges.data()); });
          },
          nb::arg("origins"), nb::arg("directions"), nb::arg("ranges"))
      .def("means", [](const SeenSurface& surface) {
        auto means = without_gil([&] { return surface.means(); });
        return array_of(std::move(means), {means.size() / SeenSurface::kColumns, SeenSurface::kColumns});
      });
  module.def(
      "column_means",
      [](In<double, nb::shape<-1, -1>> rows, double voxel_m) {
        const std::size_t columns = rows.shape(1);
        require(columns >= 3, "a row begins with x, y, z");
        auto means = without_gil([&] { return column_means(rows.data(), rows.shape(0), columns, voxel_m); });
        return array_of(std::move(means), {means.size() / columns, columns});
      },
      nb::arg("rows"), nb::arg("voxel_m"));
}

}  // namespace firstfix::python
