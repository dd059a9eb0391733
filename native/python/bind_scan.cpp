#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cmath>
#include <limits>

#include "arrays.hpp"
#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/scan/deskew.hpp"
#include "firstfix/scan/flat_patches.hpp"
#include "firstfix/scan/levelling.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/scan/up_vote.hpp"
#include "firstfix/scan/voxel_filter.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

template <class T>
using Vectors = In<T, nb::shape<-1, 3>>;
using Rotation = In<double, nb::shape<3, 3>>;
using Direction = In<double, nb::shape<3>>;
using View = In<float, nb::shape<kViewRows, kViewColumns>>;

// Of two overloads, nanobind takes the first one for an array that must be copied: that of double, which loses nothing.
template <class T>
void bind_vectors(nb::module_& module) {
  using namespace nb::literals;
  module.def(
      "first_in_voxel",
      [](Vectors<T> points, double voxel_m) {
        return array_of(without_gil([&] { return first_in_voxel(points.data(), points.shape(0), voxel_m); }));
      },
      "points"_a, "voxel_m"_a);
  module.def(
      "voxel_means",
      [](Vectors<T> points, double voxel_m, double border_m) {
        auto means = without_gil([&] { return voxel_means(points.data(), points.shape(0), voxel_m, border_m); });
        return array_of(std::move(means), {means.size() / 3, 3});
      },
      "points"_a, "voxel_m"_a, "border_m"_a = 0.0);
  module.def(
      "voxel_mean_times",
      [](Vectors<T> points, Times time_s, double voxel_m, double border_m) {
        check_times(time_s, points.shape(0));
        return array_of(without_gil(
            [&] { return voxel_mean_times(points.data(), time_s.data(), points.shape(0), voxel_m, border_m); }));
      },
      "points"_a, "time_s"_a, "voxel_m"_a, "border_m"_a = 0.0);
  module.def(
      "rows_by_voxel_hash",
      [](Vectors<T> points, double voxel_m, std::uint64_t at_most) {
        return array_of(
            without_gil([&] { return rows_by_voxel_hash(points.data(), points.shape(0), voxel_m, at_most); }));
      },
      "points"_a, "voxel_m"_a, "at_most"_a);
  module.def(
      "chosen_by_chance",
      [](Vectors<T> points, std::uint64_t at_most) {
        const std::size_t count = points.shape(0), rows = static_cast<std::size_t>(std::min<std::uint64_t>(count, at_most));
        auto chosen = memory<T>(3 * rows);
        without_gil([&] { chosen_by_chance(points.data(), count, at_most, chosen.get()); });
        return array_of(std::move(chosen), {rows, 3});
      },
      "points"_a, "at_most"_a);
  module.def(
      "turned",
      [](Vectors<T> points, Rotation R) {
        std::vector<T> rotated(points.size());
        without_gil([&] { turned(points.data(), points.shape(0), R.data(), rotated.data()); });
        return array_of(std::move(rotated), {points.shape(0), 3});
      },
      "points"_a, "R"_a);
  module.def(
      "floor_height",
      [](Vectors<T> points, Vectors<T> normals, double max_height_m) {
        require(points.shape(0) == normals.shape(0), "there is not one normal for each point");
        require(max_height_m >= 0 && max_height_m <= 1000, "the height must be in [0, 1000] m");
        return without_gil([&] { return floor_height(points.data(), normals.data(), points.shape(0), max_height_m); });
      },
      "points"_a, "normals"_a, "max_height_m"_a = 4.0);
  module.def(
      "votes",
      [](Vectors<T> normals, Vectors<double> directions) {
        std::vector<double> won(directions.shape(0));
        without_gil([&] {
          votes(normals.data(), normals.shape(0), directions.data(), directions.shape(0), won.data());
        });
        return array_of(std::move(won), {directions.shape(0)});
      },
      "normals"_a, "directions"_a);
  module.def(
      "refined_up",
      [](Vectors<T> normals, Direction up) {
        std::vector<double> refined(3);
        without_gil([&] {
          const auto found = refined_up(normals.data(), normals.shape(0), {up(0), up(1), up(2)});
          refined.assign(found.begin(), found.end());
        });
        return array_of(std::move(refined), {3});
      },
      "normals"_a, "up"_a);
}

}  // namespace

void bind_scan(nb::module_& module) {
  using namespace nb::literals;
  module.def(
      "rows_by_chance",
      [](std::uint64_t count, std::uint64_t at_most) {
        constexpr std::uint64_t kMost = std::uint64_t{1} << 30;
        require(std::min(count, at_most) < kMost, "a list has too many rows");
        return array_of(without_gil([&] { return detail::rows_by_chance(count, at_most); }));
      },
      "count"_a, "at_most"_a);
  module.def(
      "within_range",
      [](Vectors<float> points, double min_range_m, double max_range_m) {
        const std::size_t count = points.shape(0);
        auto kept = memory<float>(3 * count);
        std::size_t found = 0;
        without_gil([&] { found = within_range(points.data(), count, min_range_m, max_range_m, kept.get()); });
        return array_of(std::move(kept), {found, 3});
      },
      "points"_a, "min_range_m"_a, "max_range_m"_a);
  module.def(
      "nearest_by_direction",
      [](Vectors<float> points) {
        std::vector<float> nearest_m(kDirections, std::numeric_limits<float>::infinity());
        without_gil([&] { nearest_by_direction(points.data(), points.shape(0), nearest_m.data()); });
        return array_of(std::move(nearest_m), {kDirections});
      },
      "points"_a);
  module.def(
      "least_of_neighbours",
      [](View image) {
        std::vector<float> least_m(kDirections);
        without_gil([&] { least_of_neighbours(image.data(), least_m.data()); });
        return array_of(std::move(least_m), {kViewRows, kViewColumns});
      },
      "image"_a);
  module.def(
      "deskew",
      [](Vectors<float> points, Times time_s, In<double, nb::shape<6>> twist) {
        check_times(time_s, points.shape(0));
        const Vector6 checked = twist_of(twist.data());
        std::vector<float> deskewed(points.size());
        without_gil([&] { deskew(vectors_of(points), time_s.data(), checked, deskewed.data()); });
        return array_of(std::move(deskewed), {points.shape(0), 3});
      },
      "points"_a, "time_s"_a, "twist"_a);
  module.def(
      "flat_patches",
      [](Vectors<double> means, double side_m) {
        Patches flat = without_gil([&] { return flat_patches(means.data(), means.shape(0), side_m); });
        const std::size_t count = flat.points.size() / 3;
        return std::make_tuple(array_of(std::move(flat.points), {count, 3}),
                               array_of(std::move(flat.normals), {count, 3}));
      },
      "means"_a, "side_m"_a);
  bind_vectors<double>(module);
  bind_vectors<float>(module);
}

}  // namespace firstfix::python
