#include <nanobind/stl/tuple.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>

#include "arrays.hpp"
#include "firstfix/simulation/cast_cells.hpp"
#include "firstfix/simulation/cast_rays.hpp"
#include "firstfix/simulation/columns.hpp"
#include "firstfix/simulation/free_ways.hpp"
#include "firstfix/simulation/nearest_surface.hpp"
#include "firstfix/simulation/ray_bundles.hpp"
#include "firstfix/simulation/triangle_tree.hpp"
#include "layered_grid.hpp"
#include "rooms.hpp"

namespace firstfix::python {
namespace {

using Points = In<float, nb::shape<-1, 3>>;
using Rows = In<std::uint32_t, nb::shape<-1>>;

bool within(const Points& values, float limit) {
  bool ok = true;
  for (std::size_t i = 0; i < values.size(); ++i) ok &= std::fabs(values.data()[i]) <= limit;  // not a number: not ok
  return ok;
}

void make_tree(TriangleTree* place, Points vertices, In<std::uint32_t, nb::shape<-1, 3>> triangles) {
  const std::size_t count = triangles.shape(0);
  require(count >= 1 && count <= 1U << 30, "a mesh has between 1 and 2^30 triangles");
  require(within(vertices, TriangleTree::kMostAway), "a vertex is not finite or too far away");
  std::uint32_t highest = 0;
  for (std::size_t i = 0; i < 3 * count; ++i) highest = std::max(highest, triangles.data()[i]);
  require(highest < vertices.shape(0), "a triangle has a vertex that is not there");
  without_gil([&] { new (place) TriangleTree(vertices.data(), triangles.data(), count); });
}

// Throws ValueError for what no caster takes.
void require_rays(const Points& origins, const Points& directions, const Rows& order, float min_range_m,
                  float max_range_m) {
  require(within(origins, TriangleTree::kMostAway), "an origin is not finite or too far away");
  require(within(directions, 2), "a direction is no unit vector");
  const std::size_t count = directions.shape(0);
  require(order.shape(0) == count, "order and directions differ in length");
  for (std::size_t i = 0; i < count; ++i) require(order.data()[i] < count, "order has a row that is not there");
  require(min_range_m >= 0 && min_range_m <= max_range_m && max_range_m <= TriangleTree::kMostAway,
          "the limits of ranges are out of order");
}

auto ranges(const TriangleTree& tree, Points origins, Points directions, Rows order, float min_range_m,
            float max_range_m) {
  const std::size_t number = origins.shape(0), count = directions.shape(0);
  require_rays(origins, directions, order, min_range_m, max_range_m);
  std::vector<float> result;
  without_gil([&] {
    result.assign(number * count, std::numeric_limits<float>::infinity());
    cast_rays(tree, vectors_of(origins), vectors_of(directions), order.data(), min_range_m, max_range_m, result.data());
  });
  return array_of(std::move(result), {number, count});
}

auto occupied_cells_seen(const TriangleTree& tree, Points origins, In<float, nb::shape<-1>> height_m, Points directions,
                         Rows order, float min_range_m, float max_range_m, std::size_t rings, std::size_t sectors,
                         double cells_range_m, Edges edges_m) {
  const std::size_t number = origins.shape(0);
  require_rays(origins, directions, order, min_range_m, max_range_m);
  require(height_m.shape(0) == number, "origins and heights differ in length");
  for (std::size_t i = 0; i < number; ++i) {
    require(std::fabs(height_m.data()[i]) <= TriangleTree::kMostAway, "a height is not finite or too large");
  }
  const LayeredGrid grid = grid_of(rings, sectors, cells_range_m, edges_m);
  std::vector<std::uint8_t> bits;
  without_gil([&] {
    bits.resize(number * grid.bytes());
    cast_cells(tree, vectors_of(origins), height_m.data(), vectors_of(directions), order.data(), min_range_m, max_range_m,
               grid, bits.data());
  });
  return array_of(std::move(bits), {number, grid.bytes()});
}

auto ranges_beyond(const TriangleTree& tree, In<float, nb::shape<3>> origin, Points directions, Rows order,
                   In<float, nb::shape<-1>> beyond_m, float max_range_m) {
  const std::size_t count = directions.shape(0);
  for (int a = 0; a < 3; ++a) {
    require(std::fabs(origin.data()[a]) <= TriangleTree::kMostAway, "the origin is not finite or too far away");
  }
  require(within(directions, 2), "a direction is no unit vector");
  require(order.shape(0) == count && beyond_m.shape(0) == count, "order, ranges and directions differ in length");
  for (std::size_t i = 0; i < count; ++i) require(order.data()[i] < count, "order has a row that is not there");
  for (std::size_t i = 0; i < count; ++i) require(beyond_m.data()[i] >= 0, "a range is negative or not a number");
  require(max_range_m >= 0 && max_range_m <= TriangleTree::kMostAway, "the limit of ranges is too far away");
  std::vector<float> result;
  without_gil([&] {
    result.assign(count, std::numeric_limits<float>::infinity());
    cast_rays_beyond(tree, origin.data(), vectors_of(directions), order.data(), beyond_m.data(), max_range_m,
                     result.data());
  });
  return array_of(std::move(result), {count});
}

auto near_surface(const TriangleTree& tree, Points points, float radius_m) {
  require(within(points, TriangleTree::kMostAway), "a point is not finite or too far away");
  const std::size_t count = points.shape(0);
  std::vector<std::uint8_t> result;
  without_gil([&] {
    result.resize(count);
    for (std::size_t i = 0; i < count; ++i) result[i] = is_near_surface(tree, points.data() + 3 * i, radius_m);
  });
  return array_of(std::move(result), {count});
}

auto crossings(const TriangleTree& tree, In<double, nb::shape<-1, 2>> columns, double apart_m, std::size_t most) {
  require(apart_m >= 0 && most >= 1, "surfaces of a column have a least distance and a largest number");
  const std::size_t count = columns.shape(0);
  for (std::size_t i = 0; i < 2 * count; ++i) {
    require(std::fabs(columns.data()[i]) <= TriangleTree::kMostAway, "a column is not finite or too far away");
  }
  std::vector<std::int64_t> start{0};
  std::vector<double> z;
  std::vector<float> level;
  without_gil([&] {
    start.reserve(count + 1);
    std::vector<Crossing> found;
    for (std::size_t i = 0; i < count; ++i) {
      cross_column(tree, columns.data()[2 * i], columns.data()[2 * i + 1], apart_m, most, found);
      for (const Crossing& one : found) z.push_back(one.z), level.push_back(one.level);
      start.push_back(static_cast<std::int64_t>(z.size()));
    }
  });
  const std::size_t all = z.size();
  return std::make_tuple(array_of(std::move(start), {count + 1}), array_of(std::move(z), {all}),
                         array_of(std::move(level), {all}));
}

auto free_ways(const TriangleTree& tree, Points starts, Points ends) {
  const std::size_t count = starts.shape(0);
  require(ends.shape(0) == count, "the ways' starts and ends differ in length");
  require(within(starts, TriangleTree::kMostAway), "a start is not finite or too far away");
  require(within(ends, TriangleTree::kMostAway), "an end is not finite or too far away");
  std::vector<std::uint8_t> result;
  without_gil([&] {
    result.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      result[i] = is_way_free(tree, starts.data() + 3 * i, ends.data() + 3 * i);
    }
  });
  return array_of(std::move(result), {count});
}

}  // namespace

void bind_simulation(nb::module_& module) {
  nb::class_<TriangleTree>(module, "TriangleTree")
      .def("__init__", &make_tree, nb::arg("vertices"), nb::arg("triangles"))
      .def("ranges", &ranges, nb::arg("origins"), nb::arg("directions"), nb::arg("order"), nb::arg("min_range_m"),
           nb::arg("max_range_m"))
      .def("occupied_cells", &occupied_cells_seen, nb::arg("origins"), nb::arg("height_m"), nb::arg("directions"),
           nb::arg("order"), nb::arg("min_range_m"), nb::arg("max_range_m"), nb::arg("rings"), nb::arg("sectors"),
           nb::arg("cells_range_m"), nb::arg("edges_m"))
      .def("ranges_beyond", &ranges_beyond, nb::arg("origin"), nb::arg("directions"), nb::arg("order"),
           nb::arg("beyond_m"), nb::arg("max_range_m"))
      .def("crossings", &crossings, nb::arg("columns"), nb::arg("apart_m"), nb::arg("most"))
      .def("free_ways", &free_ways, nb::arg("starts"), nb::arg("ends"))
      .def("near_surface", &near_surface, nb::arg("points"), nb::arg("radius_m"));
  module.def(
      "bundle_rays",
      [](Points directions) {
        require(within(directions, 2), "a direction is no unit vector");
        return array_of(bundle_rays(vectors_of(directions)));
      },
      nb::arg("directions"));
}

}  // namespace firstfix::python
