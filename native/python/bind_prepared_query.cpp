#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "firstfix/query/prepared_query.hpp"
#include "layered_grid.hpp"
#include "map_numbers.hpp"
#include "queries.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

// What a robot says of its scan: rings, sectors, max_range_m and layer edges of its descriptor, the occupancy, up, the height.
using Description =
    std::tuple<std::size_t, std::size_t, double, Edges, In<std::uint8_t, nb::ndim<1>>, Direction, double>;
// T_last_scan, points and times; of a compact scan its nearest ranges, and the robot's description.
using Asked =
    std::tuple<PoseArray, Points, std::optional<Times>, std::optional<PerDirection>, std::optional<Description>>;

// Numbers of a prepared query, which owns them.
template <class T>
using Part = nb::ndarray<nb::numpy, const T>;
using Timed = std::tuple<Part<float>, std::optional<Part<float>>>;                                 // points, times
using Scanned = std::tuple<Part<float>, Part<float>, Part<std::uint8_t>, std::optional<Part<float>>>;  // points, normals, oriented, times
// Number among the scans that were asked, T_last_scan, R_level_sensor, height_m, the points within range, the view and its points if
// they have times, the thinned points.
using Kept = std::tuple<std::size_t, Doubles, Doubles, double, Part<float>, Part<std::uint8_t>, Part<float>, std::optional<Timed>, Scanned>;

std::optional<RobotDescription> description_of(const std::optional<Description>& given) {
  if (!given) return std::nullopt;
  const auto& [rings, sectors, max_range_m, edges_m, occupancy, up, height_m] = *given;
  RobotDescription made{grid_of(rings, sectors, max_range_m, edges_m), {occupancy.data(), occupancy.data() + occupancy.shape(0)},
                        direction_of(up), height_m};
  require(made.occupancy.size() == made.grid.bytes(), "the occupancy has another number of cells");
  require(std::fabs(height_m) < 1e6, "the height of a sensor is too large");
  return made;
}

AskedScan asked_of(const Asked& given) {
  const auto& [T_last_scan, points, time_s, nearest_m, described] = given;
  const std::size_t count = points.shape(0);
  if (time_s) check_times(*time_s, count);
  return {finite_pose_of(T_last_scan), {points.data(), count}, time_s ? time_s->data() : nullptr,
          nearest_m ? nearest_m->data() : nullptr, description_of(described)};
}

std::size_t points_of(nb::handle config, const char* name) {
  const double value = number(config, name);
  require(value >= 0 && value < 1 << 30, "a number of points is negative, or too large");
  return static_cast<std::size_t>(value);
}

QueryNumbers numbers_of(nb::handle preprocess, nb::handle ranking) {
  const QueryNumbers made{{number(preprocess, "min_range_m"), number(preprocess, "max_range_m"), number(preprocess, "voxel_m"),
                           points_of(preprocess, "min_points"), points_of(ranking, "voxelled_points"), points_of(ranking, "view_points"),
                           points_of(ranking, "dense_points"), points_of(ranking, "sparse_points")},
                          number(preprocess, "default_height_m"),
                          number(ranking, "spots_apart_m")};
  const Preparation& wanted = made.preparation;
  require(wanted.max_range_m <= 1e9, "the range must be at most 1e9 m");  // its square, and that of a coordinate, are numbers
  for (const std::size_t most : {wanted.voxelled_points, wanted.view_points, wanted.dense_points, wanted.sparse_points}) {
    require(most > 0, "a largest number of points is 0");
  }
  return made;
}

template <class T>
Part<T> part_of(const PreparedQuery& query, const std::vector<T>& numbers) {
  return Part<T>(numbers.data(), {numbers.size()}, nb::find(query));
}

Part<float> vectors_in(const PreparedQuery& query, const std::vector<float>& numbers) {
  return Part<float>(numbers.data(), {numbers.size() / 3, 3}, nb::find(query));
}

std::optional<Part<float>> times_in(const PreparedQuery& query, const PointsInTime& at) {
  return at.times() == nullptr ? std::nullopt : std::optional(part_of(query, at.time_s));
}

Scanned surface_in(const PreparedQuery& query, const ScannedSurface& surface) {
  return {vectors_in(query, surface.at.points), vectors_in(query, surface.normals), part_of(query, surface.oriented),
          times_in(query, surface.at)};
}

Kept kept_in(const PreparedQuery& query, std::size_t scan) {
  require(scan < query.scans().size(), "there is no such scan");
  const PreparedQuery::KeptScan& one = query.scans()[scan];
  const ViewedScan& viewed = query.searched().scans[scan];
  std::optional<Timed> returns;
  if (viewed.returns.times() != nullptr) returns = Timed(vectors_in(query, viewed.returns.points), times_in(query, viewed.returns));
  return {one.number,
          copy_of(viewed.T_last_scan, {4, 4}),
          array_of(numbers_in(one.R_level_sensor), {3, 3}),
          one.height_m,
          vectors_in(query, one.seen),
          part_of(query, viewed.view.returned),
          part_of(query, viewed.view.least_m),
          std::move(returns),
          surface_in(query, query.thinned(scan))};
}

}  // namespace

void bind_prepared_query(nb::module_& module) {
  using namespace nb::literals;
  nb::class_<PreparedQuery>(module, "PreparedQuery")
      .def("__len__", [](const PreparedQuery& query) { return query.scans().size(); })
      .def_prop_ro("spots", [](const PreparedQuery& query) { return query.searched().spots; })
      .def_prop_ro("in_range", [](const PreparedQuery& query) { return query.scans().back().seen.size() / 3; })
      .def("scan", &kept_in, "number"_a)
      .def("dense", [](const PreparedQuery& query) { return surface_in(query, query.searched().dense); })
      .def("sparse", [](const PreparedQuery& query) { return surface_in(query, query.searched().sparse); });
  module.def(
      "prepare",
      [](const std::vector<Asked>& scans, std::optional<Direction> gravity, Direction up_by_mounting,
         std::optional<In<double, nb::shape<6>>> twist, nb::handle preprocess, nb::handle ranking) {
        require(!scans.empty(), "a query has no scan");
        std::vector<AskedScan> asked;
        for (const Asked& one : scans) asked.push_back(asked_of(one));
        SensorState sensor{std::nullopt, direction_of(up_by_mounting), std::nullopt};
        if (gravity) sensor.gravity = direction_of(*gravity);
        if (twist) sensor.twist = twist_of(twist->data());
        const QueryNumbers numbers = numbers_of(preprocess, ranking);
        return without_gil([&] { return PreparedQuery::of(asked, sensor, numbers); });
      },
      "scans"_a, "gravity"_a.none(), "up_by_mounting"_a, "twist"_a.none(), "preprocess"_a, "ranking"_a);
}

}  // namespace firstfix::python
