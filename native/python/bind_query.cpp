#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "firstfix/query/joined_scans.hpp"
#include "firstfix/query/level_hypotheses.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/scan/other_ups.hpp"
#include "firstfix/scan/timed_view.hpp"
#include "grid.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Points = In<float, nb::shape<-1, 3>>;
using Direction = In<double, nb::shape<3>>;
using PerDirection = In<float, nb::shape<kDirections>>;
using PoseArray = In<double, nb::shape<4, 4>>;
using ToLevel = std::tuple<PoseArray, In<double, nb::shape<3, 3>>, Points, Points>;  // T_last_scan, R_level_sensor, points, normals
using Numbers = nb::ndarray<nb::numpy, float>;
using Octets = nb::ndarray<nb::numpy, std::uint8_t>;
using Timed = std::tuple<Numbers, std::optional<Numbers>>;                      // points, times
using Scanned = std::tuple<Numbers, Numbers, Octets, std::optional<Numbers>>;  // points, normals, oriented, times
// R_level_sensor, the height, the points within range, the view and its points if they have times, dense, sparse
using Prepared = std::tuple<nb::ndarray<nb::numpy, double>, double, Numbers, Octets, Numbers, std::optional<Timed>, Scanned,
                            std::optional<Scanned>>;

SurfacePoints surface_points(const Points& points, const Points& normals) {
  require(normals.shape(0) == points.shape(0), "there is not one normal for each point");
  return {points.data(), normals.data(), points.shape(0)};
}

std::vector<double> numbers_in(const detail::Matrix3& rows) {
  std::vector<double> numbers;
  for (const auto& row : rows) numbers.insert(numbers.end(), row.begin(), row.end());
  return numbers;
}

nb::ndarray<nb::numpy, double> vectors_in(std::vector<detail::Vector3>&& vectors) {
  const std::size_t count = vectors.size();
  return array_of(std::move(vectors), {count, 3});
}

Numbers vectors_in(std::vector<float>&& numbers) {
  const std::size_t count = numbers.size() / 3;
  return array_of(std::move(numbers), {count, 3});
}

std::optional<Numbers> times_in(std::vector<float>&& time_s) {
  if (time_s.empty()) return std::nullopt;
  return array_of(std::move(time_s));
}

Scanned surface_in(ScannedSurface&& surface) {
  return {vectors_in(std::move(surface.at.points)), vectors_in(std::move(surface.normals)),
          array_of(std::move(surface.oriented)), times_in(std::move(surface.at.time_s))};
}

using Placed = std::tuple<PoseArray, Points, Points, Flags, std::optional<Times>>;  // T_last_scan, points, normals, oriented, times

ScannedSurface surface_of(const Placed& placed) {
  const auto& [T_last_scan, points, normals, oriented, time_s] = placed;
  const std::size_t size = points.shape(0);
  require(normals.shape(0) == size && oriented.shape(0) == size, "points, normals and oriented differ in length");
  ScannedSurface made{{{points.data(), points.data() + 3 * size}, {}},
                      {normals.data(), normals.data() + 3 * size},
                      {bytes_of(oriented), bytes_of(oriented) + size}};
  if (time_s) {
    check_times(*time_s, size);
    made.at.time_s.assign(time_s->data(), time_s->data() + size);
  }
  return made;
}

std::optional<Prepared> prepared_in(std::optional<PreparedScan>&& made) {
  if (!made) return std::nullopt;
  std::vector<double> R = numbers_in(made->R_level_sensor);
  std::optional<Timed> viewed;
  if (!made->viewed.time_s.empty()) {
    viewed = Timed(vectors_in(std::move(made->viewed.points)), times_in(std::move(made->viewed.time_s)));
  }
  std::optional<Scanned> sparse;
  if (made->sparse.size() > 0) sparse = surface_in(std::move(made->sparse));
  return Prepared(array_of(std::move(R), {3, 3}), made->height_m, vectors_in(std::move(made->seen)),
                  array_of(std::move(made->view.returned)), array_of(std::move(made->view.least_m)), std::move(viewed),
                  surface_in(std::move(made->dense)), std::move(sparse));
}

Preparation preparation_of(double min_range_m, double max_range_m, double voxel_m, std::size_t min_points,
                           std::size_t voxelled_points, std::size_t view_points, std::size_t dense_points,
                           std::size_t sparse_points) {
  require(max_range_m <= 1e9, "the range must be at most 1e9 m");  // its square, and that of a coordinate, are numbers
  for (const std::size_t most : {voxelled_points, view_points, dense_points, sparse_points}) {
    require(most > 0 && most < std::size_t{1} << 30, "a largest number of points is 0, or too large");
  }
  return {min_range_m, max_range_m, voxel_m, min_points, voxelled_points, view_points, dense_points, sparse_points};
}

Levelling levelling_of(const Direction& up, bool up_is_known, std::optional<double> height_m, double default_height_m) {
  const detail::Vector3 direction{up(0), up(1), up(2)};
  const double length2 = detail::dot(direction, direction);
  require(length2 > 1e-12 && length2 < 1e18, "up has no direction");
  return {direction, up_is_known, height_m, default_height_m};
}

const float* checked(const std::optional<Times>& time_s, std::size_t count) {
  if (time_s) check_times(*time_s, count);
  return time_s ? time_s->data() : nullptr;
}

}  // namespace

void bind_query(nb::module_& module) {
  using namespace nb::literals;
  module.def(
      "prepare_scan",
      [](Points points, std::optional<Times> time_s, double min_range_m, double max_range_m, double voxel_m,
         std::size_t min_points, std::size_t voxelled_points, std::size_t view_points, std::size_t dense_points,
         std::size_t sparse_points, Direction up, bool up_is_known, double default_height_m) {
        const Preparation wanted = preparation_of(min_range_m, max_range_m, voxel_m, min_points, voxelled_points,
                                                  view_points, dense_points, sparse_points);
        const Levelling levelling = levelling_of(up, up_is_known, std::nullopt, default_height_m);
        const std::size_t count = points.shape(0);
        const float* times = checked(time_s, count);
        return prepared_in(without_gil([&] { return prepared_scan(points.data(), times, count, wanted, levelling); }));
      },
      "points"_a, "time_s"_a.none(), "min_range_m"_a, "max_range_m"_a, "voxel_m"_a, "min_points"_a, "voxelled_points"_a,
      "view_points"_a, "dense_points"_a, "sparse_points"_a, "up"_a, "up_is_known"_a, "default_height_m"_a);
  module.def(
      "prepare_compact_scan",
      [](Points points, std::optional<Times> time_s, PerDirection nearest_m, In<float, nb::shape<kDirections, 3>> directions,
         double min_range_m, double max_range_m, double voxel_m, std::size_t min_points, std::size_t dense_points,
         std::size_t sparse_points, Direction up, bool up_is_known, std::optional<double> height_m,
         double default_height_m) {
        const Preparation wanted =
            preparation_of(min_range_m, max_range_m, voxel_m, min_points, 1, 1, dense_points, sparse_points);
        const Levelling levelling = levelling_of(up, up_is_known, height_m, default_height_m);
        const std::size_t count = points.shape(0);
        const float* times = checked(time_s, count);
        return prepared_in(without_gil([&] {
          return prepared_compact_scan(points.data(), times, count, nearest_m.data(), directions.data(), wanted, levelling);
        }));
      },
      "points"_a, "time_s"_a.none(), "nearest_m"_a, "directions"_a, "min_range_m"_a, "max_range_m"_a, "voxel_m"_a,
      "min_points"_a, "dense_points"_a, "sparse_points"_a, "up"_a, "up_is_known"_a, "height_m"_a.none(),
      "default_height_m"_a);
  module.def(
      "joined_scans",
      [](const std::vector<Placed>& parts, double voxel_m, std::size_t dense_points, std::size_t sparse_points) {
        require(dense_points > 0 && sparse_points > 0, "a largest number of points is 0");
        std::vector<ScannedSurface> surfaces;
        for (const Placed& one : parts) surfaces.push_back(surface_of(one));
        std::vector<PlacedSurface> placed;
        for (std::size_t i = 0; i < parts.size(); ++i) placed.push_back({pose_of(std::get<0>(parts[i])), &surfaces[i]});
        JoinedSurface made = without_gil([&] { return joined(placed, voxel_m, dense_points, sparse_points); });
        return std::make_tuple(surface_in(std::move(made.dense)), surface_in(std::move(made.sparse)));
      },
      "parts"_a, "voxel_m"_a, "dense_points"_a, "sparse_points"_a);
  module.def(
      "timed_view",
      [](Points points, Times time_s, PerDirection nearest_m, In<float, nb::shape<kDirections, 3>> directions) {
        const std::size_t count = points.shape(0);
        check_times(time_s, count);
        PointsInTime made =
            without_gil([&] { return timed_view(points.data(), time_s.data(), count, nearest_m.data(), directions.data()); });
        return std::make_tuple(vectors_in(std::move(made.points)), array_of(std::move(made.time_s)));
      },
      "points"_a, "time_s"_a, "nearest_m"_a, "directions"_a);
  module.def(
      "height_above_floor",
      [](Points points, Points normals, Direction up) {
        const std::size_t count = points.shape(0);
        require(normals.shape(0) == count, "there is not one normal for each point");
        const Levelling levelling = levelling_of(up, true, std::nullopt, 0);
        return without_gil([&] { return height_above_floor(points.data(), normals.data(), count, levelling.up); });
      },
      "points"_a, "normals"_a, "up"_a);
  module.def(
      "other_ups",
      [](Points normals, Direction known, std::optional<Direction> gravity) {
        std::optional<detail::Vector3> down;
        if (gravity) down = levelling_of(*gravity, true, std::nullopt, 0).up;
        const detail::Vector3 tried{known(0), known(1), known(2)};
        return vectors_in(without_gil([&] { return other_ups(normals.data(), normals.shape(0), tried, down); }));
      },
      "normals"_a, "known"_a, "gravity"_a.none());
  module.def(
      "level_hypotheses",
      [](const std::vector<ToLevel>& scans, Points points, Points normals, std::optional<Direction> expected_up,
         double usual_height_m, bool tilted) {
        std::vector<ScanToLevel> to_level;
        for (const auto& [T_last_scan, R_level_sensor, thinned_points, thinned_normals] : scans) {
          ScanToLevel one{pose_of(T_last_scan), {}, surface_points(thinned_points, thinned_normals)};
          for (std::size_t i = 0; i < 9; ++i) one.R_level_sensor[i / 3][i % 3] = R_level_sensor.data()[i];
          to_level.push_back(one);
        }
        const SurfacePoints dense = surface_points(points, normals);
        std::optional<detail::Vector3> up;
        if (expected_up) up = levelling_of(*expected_up, true, std::nullopt, 0).up;
        std::vector<std::tuple<std::size_t, nb::ndarray<nb::numpy, double>, double>> found;
        for (const LevelHypothesis& one :
             without_gil([&] { return level_hypotheses(to_level, dense, up, usual_height_m, tilted); })) {
          found.emplace_back(one.scan, array_of(numbers_in(one.R_level_sensor), {3, 3}), one.height_m);
        }
        return found;
      },
      "scans"_a, "points"_a, "normals"_a, "expected_up"_a.none(), "usual_height_m"_a, "tilted"_a);
  module.def(
      "range_view",
      [](PerDirection nearest_m) {
        RangeView view = without_gil([&] { return range_view(nearest_m.data()); });
        return std::make_tuple(array_of(std::move(view.returned)), array_of(std::move(view.least_m)));
      },
      "nearest_m"_a);
}

}  // namespace firstfix::python
