#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <optional>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "candidates.hpp"
#include "firstfix/query/search.hpp"
#include "free_tables.hpp"
#include "grid.hpp"
#include "map_numbers.hpp"
#include "places.hpp"
#include "rooms.hpp"
#include "tiles.hpp"

namespace firstfix::python {

namespace {

using Points = In<float, nb::shape<-1, 3>>;
using TwistArray = In<double, nb::shape<6>>;
using Directions = nb::shape<static_cast<nb::ssize_t>(kDirections)>;
using Scanned = std::tuple<Points, Points, Flags, std::optional<Times>>;  // points, normals, oriented, times
// T_last_scan, the view's returned and least_m, and its points with their times if they have any
using Viewed = std::tuple<PoseArray, In<bool, Directions>, In<float, Directions>, std::optional<std::tuple<Points, Times>>>;
using Doubles = nb::ndarray<nb::numpy, double>;
// A pose: row of the template, start_z_m, T_level_sensor, inlier_ratio, alignment_score, information, rests, twist,
// free_space_violation, removed_surface, seen_free, beside_surface, same_plane, is_alike.
using Found = std::tuple<std::int64_t, double, Doubles, double, double, Doubles, bool, std::optional<Doubles>, double, double,
                         std::optional<double>, double, double, bool>;

ScannedSurface surface_of(const Scanned& scanned) {
  const auto& [points, normals, oriented, time_s] = scanned;
  const std::size_t size = points.shape(0);
  require(normals.shape(0) == size && oriented.shape(0) == size, "points, normals and oriented differ in length");
  ScannedSurface made;
  made.at.points.assign(points.data(), points.data() + 3 * size);
  made.normals.assign(normals.data(), normals.data() + 3 * size);
  made.oriented.assign(bytes_of(oriented), bytes_of(oriented) + size);
  if (time_s) {
    check_times(*time_s, size);
    made.at.time_s.assign(time_s->data(), time_s->data() + size);
  }
  return made;
}

ViewedScan scan_of(const Viewed& viewed) {
  const auto& [T_last_scan, returned, least, returns] = viewed;
  const auto* is_returned = reinterpret_cast<const std::uint8_t*>(returned.data());
  ViewedScan made{pose_of(T_last_scan),
                  {{is_returned, is_returned + kDirections}, {least.data(), least.data() + kDirections}},
                  {}};
  if (returns) {
    const auto& [points, time_s] = *returns;
    check_times(time_s, points.shape(0));
    made.returns.points.assign(points.data(), points.data() + 3 * points.shape(0));
    made.returns.time_s.assign(time_s.data(), time_s.data() + points.shape(0));
  }
  return made;
}

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();  // in place of a threshold

// The search, with the query that it keeps.
class BoundSearch {
 public:
  BoundSearch(const SearchedMap& map, SearchedQuery&& asked, const std::optional<PriorRegion>& prior)
      : query_(std::move(asked)), search(map, query_, prior) {}

 private:
  SearchedQuery query_;

 public:
  Search search;
};

KnownTwist known_twist(const std::optional<TwistArray>& twist) {
  if (!twist) return std::nullopt;
  return twist_of(twist->data());
}

template <std::size_t N>
Doubles copy_of(const std::array<double, N>& numbers, std::initializer_list<std::size_t> shape) {
  return array_of(std::vector<std::array<double, N>>{numbers}, shape);
}

std::vector<Found> found_by(const Search& search) {
  std::vector<Found> made;
  for (const RegisteredPose& one : search.found()) {
    const Registration& placed = one.registration;
    const Fit& fit = one.fit;
    std::optional<Doubles> twist;
    if (placed.twist) twist = copy_of(*placed.twist, {6});
    std::optional<double> seen_free;
    if (!std::isnan(fit.seen_free)) seen_free = fit.seen_free;
    made.emplace_back(one.template_row, one.start_z_m, copy_of(placed.T_level_sensor, {4, 4}), placed.inlier_ratio,
                      placed.alignment_score, copy_of(placed.information, {6, 6}), placed.rests, std::move(twist),
                      fit.free_space_violation, fit.removed_surface, seen_free, fit.beside_surface, fit.same_plane, one.is_alike);
  }
  return made;
}

}  // namespace

void bind_search(nb::module_& module) {
  using namespace nb::literals;
  nb::class_<SearchedMap>(module, "SearchedMap")
      .def(
          "__init__",
          [](SearchedMap* place, const Grid& fine, const Grid& coarse, const Tiles& near, const Tiles& far,
             const FreeTables* seen_free, const Places* places, const Aliases* alias_table, double reach_m, double spacing_m,
             nb::handle registration, nb::handle nearby,
             nb::handle aliases, nb::handle ranking, nb::handle calibration, std::size_t compared) {
            require(reach_m > 0 && reach_m < 1e6, "the reach is not positive, or too large");
            require(spacing_m > 0 && spacing_m < 1e6, "the spacing of the templates is not positive, or too large");
            require(alias_table == nullptr || (places != nullptr && places->view.count == alias_table->view.templates),
                    "the table of aliases is of other templates");
            SearchedMap made{fine.view,
                             coarse.view,
                             near.view,
                             far.view,
                             {},
                             {},
                             {},
                             reach_m,
                             spacing_m,
                             registration_of(registration),
                             nearby_of(nearby),
                             aliases_of(aliases),
                             ranking_of(ranking),
                             calibration_of(calibration),
                             compared};
            if (seen_free != nullptr) made.seen_free = seen_free->view;
            if (places != nullptr) made.places = places->view;
            if (alias_table != nullptr) made.alias_table = alias_table->view;
            new (place) SearchedMap(made);
          },
          nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>(), nb::keep_alive<1, 4>(), nb::keep_alive<1, 5>(),
          nb::keep_alive<1, 6>(), nb::keep_alive<1, 7>(), nb::keep_alive<1, 8>(), "fine"_a, "coarse"_a, "near"_a, "far"_a,
          "seen_free"_a.none(), "places"_a.none(), "alias_table"_a.none(), "reach_m"_a, "spacing_m"_a, "registration"_a,
          "nearby"_a, "aliases"_a, "ranking"_a, "calibration"_a, "compared"_a)
      .def(
          "known_aliases",
          [](const SearchedMap& map, PoseArray T_level_sensor, std::optional<PriorNumbers> prior) {
            return arrays_of(known_aliases(map, finite_pose_of(T_level_sensor), prior_of(prior)));
          },
          "T_level_sensor"_a, "prior"_a.none());
  nb::class_<BoundSearch>(module, "Search")
      .def(
          "__init__",
          [](BoundSearch* place, const SearchedMap& map, const std::vector<Viewed>& scans, const Scanned& dense,
             const Scanned& sparse, std::size_t spots, std::optional<PriorNumbers> prior) {
            require(!scans.empty(), "a query has no scan");
            SearchedQuery query{{}, surface_of(dense), surface_of(sparse), spots};
            require((query.dense.at.times() == nullptr) == (query.sparse.at.times() == nullptr),
                    "either all points have times, or none");
            for (const Viewed& one : scans) query.scans.push_back(scan_of(one));
            new (place) BoundSearch(map, std::move(query), prior_of(prior));
          },
          nb::keep_alive<1, 2>(), "map"_a, "scans"_a, "dense"_a, "sparse"_a, "spots"_a, "prior"_a.none())
      .def(
          "run",
          [](BoundSearch& bound, Rows rows, Poses T_level_sensor, Scores score, std::optional<TwistArray> twist,
             Poses aliases, bool nearby) {
            const std::vector<Candidate> candidates = candidates_of(rows, T_level_sensor, score);
            const KnownTwist known = known_twist(twist);
            const std::vector<PoseMatrix> alias_poses = finite_poses_of(aliases);
            without_gil([&] {
              bound.search.run(candidates, known, alias_poses);
              if (nearby) bound.search.search_near();
            });
            return found_by(bound.search);
          },
          "template"_a, "T_level_sensor"_a, "score"_a, "twist"_a.none(), "aliases"_a, "nearby"_a)
      .def("is_settled", [](const BoundSearch& bound) { return bound.search.is_settled(); })
      .def("explains_scan", [](const BoundSearch& bound) { return bound.search.explains_scan(); })
      .def(
          "is_accepted",
          [](const BoundSearch& bound, std::optional<double> asked) {
            return bound.search.is_accepted(bound.search.needed(asked.value_or(kNone)));
          },
          "asked"_a.none())
      .def(
          "try_aliases",
          [](BoundSearch& bound, std::optional<double> asked, bool nearby) {
            StageTimes times;
            without_gil([&] { bound.search.try_aliases(bound.search.needed(asked.value_or(kNone)), nearby, times); });
            return times.seconds();
          },
          "asked"_a.none(), "nearby"_a)
      .def("mark_look_alikes",
           [](BoundSearch& bound) {
             without_gil([&] { bound.search.mark_look_alikes(); });
             return found_by(bound.search);
           })
      .def("aliases_outside",
           [](BoundSearch& bound) { return arrays_of(without_gil([&] { return bound.search.aliases_outside(); })); })
      .def(
          "lead_outside",
          [](const BoundSearch& bound, const BoundSearch& anywhere) {
            return bound.search.lead_outside(anywhere.search.found());
          },
          "anywhere"_a)
      .def(
          "not_far_behind",
          [](BoundSearch& bound, Poses aliases, PoseArray T_level_sensor, std::optional<TwistArray> twist) {
            const std::vector<PoseMatrix> poses = finite_poses_of(aliases);
            const KnownTwist known = known_twist(twist);
            return array_of(
                without_gil([&] { return bound.search.not_far_behind(poses, pose_of(T_level_sensor), known); }));
          },
          "aliases"_a, "T_level_sensor"_a, "twist"_a.none());
}

}  // namespace firstfix::python
