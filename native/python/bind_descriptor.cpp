#include <nanobind/stl/pair.h>

#include <cstdint>

#include "arrays.hpp"
#include "firstfix/descriptor/best_shifts.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/descriptor/ring_spectra.hpp"
#include "layered_grid.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

std::size_t bytes_of(std::size_t rings, std::size_t sectors) {
  require_grid(rings, sectors);
  return (rings * sectors + 7) / 8;
}

nb::ndarray<nb::numpy, std::uint8_t> described(const float* points, const std::int64_t* start, const float* height_m,
                                               std::size_t scans, const Rotation* R, const LayeredGrid& grid) {
  std::vector<std::uint8_t> bits;
  without_gil([&] {
    bits.resize(scans * grid.bytes());
    occupied_cells(points, start, height_m, scans, R, grid, bits.data());
  });
  return array_of(std::move(bits), {scans, grid.bytes()});
}

}  // namespace

void bind_descriptor(nb::module_& module) {
  module.def(
      "occupied_cells",
      [](In<float, nb::shape<-1, 3>> points, In<std::int64_t, nb::shape<-1>> start, In<float, nb::shape<-1>> height_m,
         std::size_t rings, std::size_t sectors, double max_range_m, Edges edges_m) {
        const LayeredGrid grid = grid_of(rings, sectors, max_range_m, edges_m);
        const std::size_t scans = height_m.shape(0);
        require(start.shape(0) == scans + 1, "the scans' first points do not fit their heights");
        const auto count = static_cast<std::int64_t>(points.shape(0));
        std::int64_t before = 0;
        for (std::size_t i = 0; i <= scans; ++i) {
          require(before <= start.data()[i] && start.data()[i] <= count, "a scan's first point is out of range");
          before = start.data()[i];
        }
        return described(points.data(), start.data(), height_m.data(), scans, nullptr, grid);
      },
      nb::arg("points"), nb::arg("start"), nb::arg("height_m"), nb::arg("rings"), nb::arg("sectors"),
      nb::arg("max_range_m"), nb::arg("edges_m"));
  module.def(
      "turned_occupied_cells",
      [](In<float, nb::shape<-1, 3>> points, In<double, nb::shape<3, 3>> R, double height_m, std::size_t rings,
         std::size_t sectors, double max_range_m, Edges edges_m) {
        const LayeredGrid grid = grid_of(rings, sectors, max_range_m, edges_m);
        Rotation rotation;
        for (std::size_t i = 0; i < 9; ++i) rotation[i] = static_cast<float>(R.data()[i]);
        const std::int64_t start[] = {0, static_cast<std::int64_t>(points.shape(0))};
        const auto height = static_cast<float>(height_m);
        return described(points.data(), start, &height, 1, &rotation, grid);
      },
      nb::arg("points"), nb::arg("R"), nb::arg("height_m"), nb::arg("rings"), nb::arg("sectors"),
      nb::arg("max_range_m"), nb::arg("edges_m"));
  module.def(
      "ring_spectra",
      [](In<std::uint8_t, nb::shape<-1, -1>> occupancy, std::size_t rings, std::size_t sectors,
         std::size_t coefficients) {
        require(occupancy.shape(1) == bytes_of(rings, sectors), "the occupancy has another number of cells");
        require(coefficients >= 1, "a key keeps at least one coefficient");
        const std::size_t scans = occupancy.shape(0);
        std::vector<float> keys;
        std::size_t size;
        without_gil([&] {
          RingSpectra spectra(rings, sectors, coefficients);
          size = spectra.size();
          keys.resize(scans * size);
          for (std::size_t i = 0; i < scans; ++i) {
            spectra.key(occupancy.data() + i * occupancy.shape(1), occupancy.shape(1), &keys[i * size]);
          }
        });
        return array_of(std::move(keys), {scans, size});
      },
      nb::arg("occupancy"), nb::arg("rings"), nb::arg("sectors"), nb::arg("coefficients"));
  module.def(
      "best_shifts",
      [](In<std::uint8_t, nb::shape<-1>> query, In<std::uint8_t, nb::shape<-1, -1>> templates,
         In<std::int64_t, nb::shape<-1>> rows, std::size_t rings, std::size_t sectors) {
        const std::size_t bytes = bytes_of(rings, sectors), count = rows.shape(0);
        require(query.shape(0) == bytes && templates.shape(1) == bytes, "an occupancy has another number of cells");
        const auto known = static_cast<std::int64_t>(templates.shape(0));
        for (std::size_t i = 0; i < count; ++i) {
          require(0 <= rows.data()[i] && rows.data()[i] < known, "the row of a template is out of range");
        }
        std::vector<std::int64_t> shift;
        std::vector<float> score;
        without_gil([&] {
          shift.resize(count), score.resize(count);
          BestShifts(query.data(), bytes, rings, sectors)
              .compare(templates.data(), rows.data(), count, shift.data(), score.data());
        });
        return std::pair(array_of(std::move(shift), {count}), array_of(std::move(score), {count}));
      },
      nb::arg("query"), nb::arg("templates").noconvert(), nb::arg("rows"), nb::arg("rings"), nb::arg("sectors"));
}

}  // namespace firstfix::python
