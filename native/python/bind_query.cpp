#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "firstfix/query/level_hypotheses.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/query/scan_facts.hpp"
#include "firstfix/scan/other_ups.hpp"
#include "firstfix/scan/timed_view.hpp"
#include "queries.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using ToLevel = std::tuple<PoseArray, In<double, nb::shape<3, 3>>, Points, Points>;  // T_last_scan, R_level_sensor, points, normals

SurfacePoints surface_points(const Points& points, const Points& normals) {
  require(normals.shape(0) == points.shape(0), "there is not one normal for each point");
  return {points.data(), normals.data(), points.shape(0)};
}

nb::ndarray<nb::numpy, double> vectors_in(std::vector<detail::Vector3>&& vectors) {
  const std::size_t count = vectors.size();
  return array_of(std::move(vectors), {count, 3});
}

// Of a few points of a scan, all finite.
Vectors<const float> part_of(const Points& points) {
  const float* const numbers = points.data();
  require(points.shape(0) > 0, "there are no points");
  require(std::all_of(numbers, numbers + points.size(), [](float metres) { return std::fabs(metres) < 1e9F; }),
          "a coordinate is not finite, or too large");
  return {numbers, points.shape(0)};
}

}  // namespace

void bind_query(nb::module_& module) {
  using namespace nb::literals;
  module.def(
      "timed_view",
      [](Points points, Times time_s, PerDirection nearest_m, In<float, nb::shape<kDirections, 3>> directions) {
        const std::size_t count = points.shape(0);
        check_times(time_s, count);
        PointsInTime made =
            without_gil([&] { return timed_view(points.data(), time_s.data(), count, nearest_m.data(), directions.data()); });
        const std::size_t returns = made.size();
        return std::make_tuple(array_of(std::move(made.points), {returns, 3}), array_of(std::move(made.time_s)));
      },
      "points"_a, "time_s"_a, "nearest_m"_a, "directions"_a);
  module.def(
      "height_above_floor",
      [](Points points, Points normals, Direction up) {
        const std::size_t count = points.shape(0);
        require(normals.shape(0) == count, "there is not one normal for each point");
        const detail::Vector3 known = direction_of(up);
        return without_gil([&] { return height_above_floor(points.data(), normals.data(), count, known); });
      },
      "points"_a, "normals"_a, "up"_a);
  module.def(
      "other_ups",
      [](Points normals, Direction known, std::optional<Direction> gravity) {
        std::optional<detail::Vector3> down;
        if (gravity) down = direction_of(*gravity);
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
        if (expected_up) up = direction_of(*expected_up);
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
  module.def(
      "scan_facts",
      [](Points part) {
        const PartFacts made = without_gil([part = part_of(part)] { return scan_facts(part); });
        return std::make_tuple(made.median_range_m, made.largest_range_m, made.rings, made.plane_ratio);
      },
      "part"_a);
  module.def(
      "is_spread_elsewhere",
      [](Points part, double suspect, double probe_m) {
        return without_gil([part = part_of(part), suspect, probe_m] { return is_spread_elsewhere(part, suspect, probe_m); });
      },
      "part"_a, "suspect"_a, "probe_m"_a);
}

}  // namespace firstfix::python
