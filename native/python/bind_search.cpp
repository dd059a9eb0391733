#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "arrays.hpp"
#include "candidates.hpp"
#include "firstfix/query/prepared_query.hpp"
#include "firstfix/query/search.hpp"
#include "free_tables.hpp"
#include "grid.hpp"
#include "map_numbers.hpp"
#include "places.hpp"
#include "queries.hpp"
#include "rooms.hpp"
#include "tiles.hpp"

namespace firstfix::python {

namespace {

using TwistArray = In<double, nb::shape<6>>;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();  // in place of a threshold

KnownTwist known_twist(const std::optional<TwistArray>& twist) {
  if (!twist) return std::nullopt;
  return twist_of(twist->data());
}

}  // namespace

void bind_search(nb::module_& module) {
  using namespace nb::literals;
  nb::class_<SearchedMap>(module, "SearchedMap")
      .def(
          "__init__",
          [](SearchedMap* place, PoseArray T_map_level, const Grid& fine, const Grid& coarse, const Tiles& near, const Tiles& far,
             const FreeTables* seen_free, const Places* places, const Aliases* alias_table, double reach_m, double spacing_m,
             nb::handle registration, nb::handle nearby,
             nb::handle aliases, nb::handle ranking, nb::handle calibration, std::size_t compared, nb::handle search,
             double usual_height_m, double default_height_m) {
            require(std::fabs(usual_height_m) < 1e6 && std::fabs(default_height_m) < 1e6, "a height of a sensor is too large");
            require(reach_m > 0 && reach_m < 1e6, "the reach is not positive, or too large");
            require(spacing_m > 0 && spacing_m < 1e6, "the spacing of the templates is not positive, or too large");
            require(alias_table == nullptr || (places != nullptr && places->view.count == alias_table->view.templates),
                    "the table of aliases is of other templates");
            SearchedMap made{finite_pose_of(T_map_level),
                             fine.view,
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
                             compared,
                             effort_of(search),
                             usual_height_m,
                             default_height_m};
            if (seen_free != nullptr) made.seen_free = seen_free->view;
            if (places != nullptr) made.places = places->view;
            if (alias_table != nullptr) made.alias_table = alias_table->view;
            new (place) SearchedMap(made);
          },
          nb::keep_alive<1, 3>(), nb::keep_alive<1, 4>(), nb::keep_alive<1, 5>(), nb::keep_alive<1, 6>(),
          nb::keep_alive<1, 7>(), nb::keep_alive<1, 8>(), nb::keep_alive<1, 9>(), "T_map_level"_a, "fine"_a, "coarse"_a, "near"_a, "far"_a,
          "seen_free"_a.none(), "places"_a.none(), "alias_table"_a.none(), "reach_m"_a, "spacing_m"_a, "registration"_a,
          "nearby"_a, "aliases"_a, "ranking"_a, "calibration"_a, "compared"_a, "search"_a,
          "usual_height_m"_a, "default_height_m"_a)
      .def(
          "known_aliases",
          [](const SearchedMap& map, PoseArray T_level_sensor, std::optional<PriorNumbers> prior) {
            return arrays_of(known_aliases(map, finite_pose_of(T_level_sensor), prior_of(prior)));
          },
          "T_level_sensor"_a, "prior"_a.none());
  nb::class_<Search>(module, "Search")
      .def(
          "__init__",
          [](Search* place, const SearchedMap& map, const PreparedQuery& query, std::optional<PriorNumbers> prior) {
            new (place) Search(map, query.searched(), prior_of(prior));
          },
          nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>(), "map"_a, "query"_a, "prior"_a.none())
      .def(
          "run",
          [](Search& search, Rows rows, Poses T_level_sensor, Scores score, std::optional<TwistArray> twist,
             Poses aliases, bool nearby) {
            const std::vector<Candidate> candidates = candidates_of(rows, T_level_sensor, score);
            const KnownTwist known = known_twist(twist);
            const std::vector<PoseMatrix> alias_poses = finite_poses_of(aliases);
            without_gil([&] {
              search.run(candidates, known, alias_poses);
              if (nearby) search.search_near();
            });
            return found_in(search.found());
          },
          "template"_a, "T_level_sensor"_a, "score"_a, "twist"_a.none(), "aliases"_a, "nearby"_a)
      .def(
          "align",
          [](Search& search, Rows rows, Poses T_level_sensor, Scores score) {
            const std::vector<Candidate> candidates = candidates_of(rows, T_level_sensor, score);
            without_gil([&] { search.align(candidates, std::nullopt); });
          },
          "template"_a, "T_level_sensor"_a, "score"_a)
      .def("may_explain_scan", [](Search& search) { return without_gil([&] { return search.may_explain_scan(); }); })
      .def("is_settled", [](const Search& search) { return search.is_settled(); })
      .def("explains_scan", [](const Search& search) { return search.explains_scan(); })
      .def(
          "is_accepted",
          [](const Search& search, std::optional<double> asked) {
            return search.is_accepted(search.needed(asked.value_or(kNone)));
          },
          "asked"_a.none())
      .def(
          "try_aliases",
          [](Search& search, std::optional<double> asked, bool nearby) {
            StageTimes times;
            without_gil([&] { search.try_aliases(search.needed(asked.value_or(kNone)), nearby, times); });
            return times.seconds();
          },
          "asked"_a.none(), "nearby"_a)
      .def("mark_look_alikes",
           [](Search& search) {
             without_gil([&] { search.mark_look_alikes(); });
             return found_in(search.found());
           })
      .def("aliases_outside",
           [](Search& search) { return arrays_of(without_gil([&] { return search.aliases_outside(); })); })
      .def(
          "lead_outside",
          [](const Search& search, const Search& anywhere) {
            return search.lead_outside(anywhere.found());
          },
          "anywhere"_a)
      .def(
          "not_far_behind",
          [](Search& search, Poses aliases, PoseArray T_level_sensor, std::optional<TwistArray> twist) {
            const std::vector<PoseMatrix> poses = finite_poses_of(aliases);
            const KnownTwist known = known_twist(twist);
            return array_of(
                without_gil([&] { return search.not_far_behind(poses, pose_of(T_level_sensor), known); }));
          },
          "aliases"_a, "T_level_sensor"_a, "twist"_a.none());
}

}  // namespace firstfix::python
