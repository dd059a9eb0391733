#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>

#include "arrays.hpp"
#include "firstfix/mesh/cell_planes.hpp"
#include "firstfix/mesh/surface_net.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Points = In<double, nb::shape<-1, 3>>;

void require_cells(std::size_t rows, double cell_m) {
  constexpr std::size_t kMostRows = std::size_t{1} << 26;  // each with 27 cells around: 31 bits number them all
  require(cell_m >= 1e-6 && cell_m <= 1e6, "the edge of a cell is less than 1e-6 m, or over 1e6 m");
  require(rows <= kMostRows, "there are too many points");
}

}  // namespace

void bind_mesh(nb::module_& module) {
  using namespace nb::literals;
  module.def(
      "cell_planes",
      [](Points points, double cell_m) {
        require_cells(points.shape(0), cell_m);
        CellPlanes planes = without_gil([&] { return cell_planes(points.data(), points.shape(0), cell_m); });
        const std::size_t cells = planes.weights.size();
        return std::make_tuple(array_of(std::move(planes.means), {cells, 3}),
                               array_of(std::move(planes.normals), {cells, 3}),
                               array_of(std::move(planes.weights), {cells}),
                               array_of(std::move(planes.supports), {cells}),
                               array_of(std::move(planes.best), {cells}));
      },
      "points"_a, "cell_m"_a);
  module.def(
      "surface_net",
      [](Points means, Points normals, In<double, nb::shape<-1>> weights, Points near, double cell_m,
         double reach_cells, double trim_cells) {
        const std::size_t rows = means.shape(0);
        require(normals.shape(0) == rows && weights.shape(0) == rows, "there is not one normal and weight for each mean");
        require_cells(rows, cell_m);
        require_cells(near.shape(0), cell_m);
        constexpr double kMostCells = 4.0;  // work and memory grow with its third power
        require(reach_cells > 0 && reach_cells <= kMostCells && trim_cells > 0 && trim_cells <= kMostCells,
                "reach and trim are more than 0 and at most 4 cells");
        require(std::all_of(normals.data(), normals.data() + normals.size(), [](double n) { return std::fabs(n) <= 2; }),
                "a normal is not a unit vector");
        require(std::all_of(weights.data(), weights.data() + rows, [](double w) { return w > 0 && w <= 1e9; }),
                "a weight is not positive, or over 1e9");
        SurfaceNet net;
        without_gil([&] {
          net = surface_net(means.data(), normals.data(), weights.data(), rows, near.data(), near.shape(0), cell_m,
                            reach_cells, trim_cells);
        });
        const std::size_t vertices = net.vertices.size() / 3, triangles = net.triangles.size() / 3;
        return std::make_tuple(array_of(std::move(net.vertices), {vertices, 3}),
                               array_of(std::move(net.triangles), {triangles, 3}));
      },
      "means"_a, "normals"_a, "weights"_a, "near"_a, "cell_m"_a, "reach_cells"_a, "trim_cells"_a);
}

}  // namespace firstfix::python
