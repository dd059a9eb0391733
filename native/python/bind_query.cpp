#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cmath>
#include <optional>
#include <tuple>

#include "arrays.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Points = In<float, nb::shape<-1, 3>>;
using Direction = In<double, nb::shape<3>>;
using PerDirection = In<float, nb::shape<kDirections>>;
using Numbers = nb::ndarray<nb::numpy, float>;
using Octets = nb::ndarray<nb::numpy, std::uint8_t>;
using Timed = std::tuple<Numbers, std::optional<Numbers>>;                      // points, times
using Scanned = std::tuple<Numbers, Numbers, Octets, std::optional<Numbers>>;  // points, normals, oriented, times
// R_level_sensor, the height, the points within range, the view and its points if they have times, dense, sparse
using Prepared = std::tuple<nb::ndarray<nb::numpy, double>, double, Numbers, Octets, Numbers, std::optional<Timed>, Scanned,
                            std::optional<Scanned>>;

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

std::optional<Prepared> prepared_in(std::optional<PreparedScan>&& made) {
  if (!made) return std::nullopt;
  std::vector<double> R;
  for (const auto& row : made->R_level_sensor) R.insert(R.end(), row.begin(), row.end());
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
      "height_above_floor",
      [](Points points, Points normals, Direction up) {
        const std::size_t count = points.shape(0);
        require(normals.shape(0) == count, "there is not one normal for each point");
        const Levelling levelling = levelling_of(up, true, std::nullopt, 0);
        return without_gil([&] { return height_above_floor(points.data(), normals.data(), count, levelling.up); });
      },
      "points"_a, "normals"_a, "up"_a);
  module.def(
      "range_view",
      [](PerDirection nearest_m) {
        RangeView view = without_gil([&] { return range_view(nearest_m.data()); });
        return std::make_tuple(array_of(std::move(view.returned)), array_of(std::move(view.least_m)));
      },
      "nearest_m"_a);
}

}  // namespace firstfix::python
