#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>

#include "arrays.hpp"
#include "firstfix/mesh/by_first_use.hpp"
#include "firstfix/mesh/cell_planes.hpp"
#include "firstfix/mesh/in_sight.hpp"
#include "firstfix/mesh/surface_net.hpp"
#include "firstfix/mesh/with_neighbours.hpp"
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
  module.def(
      "with_neighbours",
      [](Points points, double radius_m, std::size_t least) {
        const std::size_t count = points.shape(0);
        require(radius_m > 0 && std::isfinite(radius_m), "a neighbourhood has a size");
        require(std::all_of(points.data(), points.data() + points.size(), [](double at) { return std::isfinite(at); }),
                "a point is not finite");
        auto kept = memory<std::uint8_t>(count);
        without_gil([&] { with_neighbours(points.data(), count, radius_m, least, kept.get()); });
        return array_of(std::move(kept), {count});
      },
      "points"_a, "radius_m"_a, "least"_a);
  module.def(
      "in_sight",
      [](In<std::uint8_t, nb::shape<-1, -1, -1>> occupied, In<std::int64_t, nb::shape<3>> low, double voxel_m,
         Points points, Points outwards, Points places, double start_voxels, std::size_t steps) {
        const std::size_t count = points.shape(0);
        require(outwards.shape(0) == count && places.shape(0) == count, "there is not one direction and place for each point");
        require(voxel_m > 0 && std::isfinite(voxel_m) && std::isfinite(start_voxels), "a voxel has a size");
        constexpr std::size_t kMostSteps = 1 << 16;
        require(steps <= kMostSteps, "there are too many steps");
        constexpr std::int64_t kFar = std::int64_t{1} << 52;  // doubles hold such numbers exactly
        OccupiedVoxels voxels{occupied.data(), {}, {}, voxel_m};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          voxels.size[axis] = static_cast<std::int64_t>(occupied.shape(axis));
          voxels.low[axis] = low.data()[axis];
          require(voxels.low[axis] >= -kFar && voxels.low[axis] <= kFar, "a voxel is too far away");
        }
        auto seen = memory<std::uint8_t>(count);
        without_gil([&] {
          in_sight(voxels, points.data(), outwards.data(), places.data(), count, start_voxels, steps, seen.get());
        });
        return array_of(std::move(seen), {count});
      },
      "occupied"_a, "low"_a, "voxel_m"_a, "points"_a, "outwards"_a, "places"_a, "start_voxels"_a, "steps"_a);
  module.def(
      "by_first_use",
      [](In<std::int64_t, nb::shape<-1, 3>> triangles, In<std::int64_t, nb::shape<-1>> start, std::size_t vertices) {
        const std::int64_t* first = start.data();
        require(start.size() > 0 && first[0] == 0 && std::is_sorted(first, first + start.size()) &&
                    first[start.size() - 1] == static_cast<std::int64_t>(triangles.shape(0)),
                "the tiles do not hold each triangle once");
        constexpr std::size_t kMostVertices = std::size_t{1} << 28;  // for each a number is held
        require(vertices <= kMostVertices, "there are too many vertices");
        require(std::all_of(triangles.data(), triangles.data() + triangles.size(),
                            [=](auto corner) { return corner >= 0 && static_cast<std::size_t>(corner) < vertices; }),
                "a triangle has a corner that is no vertex");
        VerticesByUse found;
        without_gil([&] { found = by_first_use(triangles.data(), first, start.size() - 1, vertices); });
        const std::size_t number = found.triangles.size() / 3;
        return std::make_tuple(array_of(std::move(found.used)), array_of(std::move(found.triangles), {number, 3}),
                               array_of(std::move(found.vertex_start)));
      },
      "triangles"_a, "start"_a, "vertices"_a);
}

}  // namespace firstfix::python
