#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "candidates.hpp"
#include "cascade_tables.hpp"
#include "firstfix/query/answered.hpp"
#include "firstfix/query/prepared_query.hpp"
#include "map_numbers.hpp"
#include "queries.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Levelling = std::tuple<In<double, nb::shape<3, 3>>, double>;  // R_level_sensor, height_m
// A place of an answer: number of its search, row of the template, T_map_sensor, fit (as firstfix.answer.quality.AlignmentQuality),
// its share of the probability.
using Quality = std::tuple<double, double, double, double, double, double, std::optional<double>>;
using Place = std::tuple<std::size_t, std::int64_t, Doubles, Quality, double>;
using Free = std::tuple<bool, Doubles, double>;  // whether it is a turn, the direction, the standard deviation
// T_map_base, covariance, the free directions, the motion
using Placed = std::tuple<std::optional<Doubles>, Doubles, std::vector<Free>, std::optional<Doubles>>;

constexpr std::size_t kMostCandidates = 1000;

// A Python object that may be let go of without the lock.
std::shared_ptr<nb::object> held(nb::object&& object) {
  return {new nb::object(std::move(object)), [](nb::object* one) {
            const nb::gil_scoped_acquire lock;
            delete one;
          }};
}

Matches matches_of(const nb::object& found, std::size_t templates) {
  std::tuple<Rows, In<double, nb::ndim<1>>, In<float, nb::ndim<1>>> arrays;
  if (!nb::try_cast(found, arrays)) throw nb::type_error("a search of templates does not give rows, yaw_rad and score");
  const auto& [rows, yaw_rad, score] = arrays;
  const std::size_t count = rows.shape(0);
  require(yaw_rad.shape(0) == count && score.shape(0) == count, "a match has one row, one yaw and one score");
  for (std::size_t i = 0; i < count; ++i) {
    require(rows(i) >= 0 && static_cast<std::size_t>(rows(i)) < templates, "the row of a template is out of range");
    require(std::isfinite(yaw_rad(i)) && std::isfinite(score(i)), "a match is not finite");
  }
  return {{rows.data(), rows.data() + count}, {yaw_rad.data(), yaw_rad.data() + count}, {score.data(), score.data() + count}};
}

// Those matches whose rows are among ascending ones, if some are given.
Matches of_these(Matches&& found, const TemplateRows* among) {
  if (among == nullptr) return std::move(found);
  Matches kept;
  for (std::size_t i = 0; i < found.rows.size(); ++i) {
    if (!std::binary_search(among->begin(), among->end(), found.rows[i])) continue;
    kept.rows.push_back(found.rows[i]), kept.yaw_rad.push_back(found.yaw_rad[i]), kept.score.push_back(found.score[i]);
  }
  return kept;
}

// The way of templates that Python finds: `describe(scan, R_level_sensor, height_m, is_as_measured)` gives a function
// `(centre_m, radius_m, clusters) -> (rows, yaw_rad, score)`. Both take the lock; the ladder around them does not have it.
Describe by_python(nb::object&& describe, std::size_t templates) {
  return [described = held(std::move(describe)), templates](const QueriedScan&, const LevelledScan& levelled) {
    const nb::gil_scoped_acquire lock;
    std::vector<double> R;
    for (const auto& row : levelled.R_level_sensor) R.insert(R.end(), row.begin(), row.end());
    auto find = held((*described)(levelled.scan, array_of(std::move(R), {3, 3}), levelled.height_m, levelled.is_as_measured));
    return FindTemplates([find, templates](const std::optional<Sphere>& within, std::size_t clusters, const TemplateRows* among) {
      const nb::gil_scoped_acquire again;
      if (!within) return of_these(matches_of((*find)(nb::none(), 0.0, clusters), templates), among);
      const auto& [x_m, y_m, z_m] = within->centre_m;
      return of_these(matches_of((*find)(array_of(std::vector<double>{x_m, y_m, z_m}), within->radius_m, clusters), templates), among);
    });
  };
}

Describe describe_of(nb::object&& retrieval, const SearchedMap& map) {
  require(map.places.has_value(), "a map without templates is not searched");
  const std::size_t templates = map.places->count;
  if (!nb::isinstance<CascadeTables>(retrieval)) return by_python(std::move(retrieval), templates);
  const auto* tables = nb::cast<const CascadeTables*>(retrieval);
  require(tables->templates() == templates, "the map's places are those of other templates");
  return tables->describe();
}

// Its grid, if the templates are described by their occupancy here.
const LayeredGrid* grid_of(const nb::object& retrieval) {
  return nb::isinstance<CascadeTables>(retrieval) ? &nb::cast<const CascadeTables*>(retrieval)->grid() : nullptr;
}

// A cancellation and what holds its word.
struct SharedCancellation {
  In<std::uint64_t, nb::shape<1>> held;
  Cancellation shared;
};

SharedCancellation cancellation_of(In<std::uint64_t, nb::shape<1>> word, std::uint64_t number) {
  require(reinterpret_cast<std::uintptr_t>(word.data()) % alignof(Cancellation::Word) == 0, "a word is aligned");
  const auto* shared = reinterpret_cast<const Cancellation::Word*>(word.data());
  return {std::move(word), {*shared, number}};
}

std::vector<MapSearch*> searches_in(const std::vector<MapSearch*>& given) {
  for (const MapSearch* const one : given) require(one != nullptr, "a search is None");
  return given;
}

Place place_of(const AnsweredPlace& one) {
  const Fit& fit = one.pose->fit;
  return {one.search, one.pose->template_row, copy_of(one.T_map_sensor, {4, 4}),
          Quality(fit.inlier_ratio, fit.alignment_score, fit.free_space_violation, fit.removed_surface, fit.beside_surface,
                  fit.same_plane, seen_free_of(fit)),
          one.share};
}

std::optional<Placed> placed_of(const Answered& answer) {
  if (!answer.pose) return std::nullopt;
  const AnsweredPose& pose = *answer.pose;
  std::optional<Doubles> T_map_base, twist;
  if (pose.T_map_base) T_map_base = copy_of(*pose.T_map_base, {4, 4});
  const KnownTwist& solved = answer.places.front().pose->registration.twist;
  if (solved) twist = copy_of(*solved, {6});
  std::vector<Free> free;
  for (const FreeAxis& one : pose.degenerate) free.emplace_back(one.is_turn, copy_of(one.direction, {3}), one.sigma);
  return Placed(std::move(T_map_base), copy_of(pose.covariance, {6, 6}), std::move(free), std::move(twist));
}

template <class Work>
StageTimes::Seconds timed(Work&& work) {
  StageTimes times;
  without_gil([&] { work(times); });
  return times.seconds();
}

}  // namespace

void bind_map_search(nb::module_& module) {
  using namespace nb::literals;
  module.attr("SPOT_M") = kSpotM;
  module.attr("SPOT_DEG") = kSpotDeg;
  module.attr("MOST_PER_SPOT") = kMostPerSpot;
  nb::enum_<Step>(module, "Step")
      .value("NARROW", Step::narrow)
      .value("WIDE", Step::wide)
      .value("OTHER_UPS", Step::other_ups)
      .value("EXHAUSTIVE", Step::exhaustive);
  nb::class_<SharedCancellation>(module, "Cancellation")
      .def(
          "__init__",
          [](SharedCancellation* place, In<std::uint64_t, nb::shape<1>> word, std::uint64_t number) {
            new (place) SharedCancellation(cancellation_of(std::move(word), number));
          },
          "word"_a.noconvert(), "number"_a)
      .def_prop_ro("is_requested", [](const SharedCancellation& one) { return one.shared.is_requested(); });
  nb::class_<MapSearch>(module, "MapSearch")
      .def(
          "__init__",
          [](MapSearch* place, const SearchedMap& map, nb::object retrieval, const PreparedQuery& query,
             std::optional<PriorNumbers> prior, std::optional<std::size_t> max_candidates, std::optional<double> asked, double left_s,
             const SharedCancellation* cancellation) {
            require(!max_candidates || (*max_candidates >= 1 && *max_candidates <= kMostCandidates), "max_candidates is out of range");
            const SensorState& sensor = query.sensor();
            Deadline deadline = Deadline::after_s(left_s);
            if (cancellation != nullptr) deadline = deadline.unless(cancellation->shared);
            const SearchOptions options{prior_of(prior), sensor.gravity, sensor.up_by_mounting, max_candidates,
                                        asked.value_or(std::numeric_limits<double>::quiet_NaN()), deadline};
            std::vector<QueriedScan> scans = query.queried(grid_of(retrieval));
            Describe describe = describe_of(std::move(retrieval), map);
            without_gil([&] { new (place) MapSearch(map, query.searched(), std::move(scans), std::move(describe), options); });
          },
          nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>(), nb::keep_alive<1, 4>(), nb::keep_alive<1, 9>(), "map"_a, "retrieval"_a,
          "query"_a, "prior"_a.none(), "max_candidates"_a.none(), "asked"_a.none(), "left_s"_a, "cancellation"_a.none())
      .def("take",
           [](MapSearch& search, Step step) {
             return timed([&](StageTimes& times) {
               search.take(step, times);
               search.rank(times);
             });
           },
           "step"_a)
      .def("may_fit",
           [](MapSearch& search, double inlier_ratio) {
             StageTimes times;
             return without_gil([&] { return search.may_fit(inlier_ratio, times); });
           },
           "inlier_ratio"_a)
      .def("found", [](const MapSearch& search) { return found_in(search.found()); })
      .def_prop_ro("outside_lead", [](const MapSearch& search) { return search.outside_lead(); })
      .def_prop_ro("taken", [](const MapSearch& search) { return search.taken(); })
      .def("is_settled", [](const MapSearch& search) { return search.is_settled(); });
  module.def(
      "answered",
      [](const std::vector<MapSearch*>& searches, bool is_one_likely, std::optional<PoseArray> T_base_sensor) {
        const std::vector<MapSearch*> all = searches_in(searches);
        std::optional<PoseMatrix> mounting;
        if (T_base_sensor) mounting = finite_pose_of(*T_base_sensor);
        StageTimes times;
        const Answered made = without_gil([&] { return answered(all, is_one_likely, mounting, times); });
        std::vector<Place> places;
        for (const AnsweredPlace& one : made.places) places.push_back(place_of(one));
        return std::make_tuple(code_of(made.decision.why), made.decision.probability, std::move(places), placed_of(made), times.seconds());
      },
      "searches"_a, "is_one_likely"_a, "T_base_sensor"_a.none());
  module.def(
      "similar_places",
      [](const SearchedMap& map, nb::object retrieval, Levelling levelling, Bits occupancy, std::optional<PriorNumbers> prior,
         std::size_t most, std::size_t clusters) {
        const auto& [R_level_sensor, height_m] = levelling;
        require(std::fabs(height_m) < 1e6, "the height of a sensor is too large");
        QueriedScan scan{{detail::kSameFrame, {}, {}}, height_m, {}, occupancy.data()};
        for (std::size_t i = 0; i < 9; ++i) scan.measured.R_level_sensor[i / 3][i % 3] = R_level_sensor.data()[i];
        if (nb::isinstance<CascadeTables>(retrieval)) nb::cast<const CascadeTables*>(retrieval)->checked(occupancy);
        const Describe describe = describe_of(std::move(retrieval), map);
        const std::optional<PriorRegion> region = prior_of(prior);
        return arrays_of(without_gil([&] {
          const LevelledScan levelled{0, scan.measured.R_level_sensor, height_m, true};
          return similar_places(*map.places, map.spacing_m, describe(scan, levelled), detail::kSameFrame, levelled, region, {most, clusters});
        }));
      },
      "map"_a, "retrieval"_a, "levelling"_a, "occupancy"_a, "prior"_a.none(), "most"_a, "clusters"_a);
  module.def(
      "expected_s",
      [](Step step, nb::handle search, double narrow_s) { return expected_s(step, effort_of(search), narrow_s); }, "step"_a, "search"_a,
      "narrow_s"_a);
}

}  // namespace firstfix::python
