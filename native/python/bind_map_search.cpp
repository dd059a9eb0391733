#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "candidates.hpp"
#include "cascade_tables.hpp"
#include "firstfix/query/climb.hpp"
#include "map_numbers.hpp"
#include "queries.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Direction = In<double, nb::shape<3>>;
using Levelling = std::tuple<In<double, nb::shape<3, 3>>, double>;  // R_level_sensor, height_m
// What the ladder reads of a scan beside its view: its levelling, all points within range, the robot's own occupancy, the thinned points
// and their normals.
using Described = std::tuple<Levelling, Points, std::optional<Bits>, Points, Points>;

constexpr std::size_t kMostCandidates = 1000;
constexpr PoseMatrix kSameFrame{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

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

// The way of templates that Python finds: `describe(scan, R_level_sensor, height_m, is_as_measured)` gives a function
// `(centre_m, radius_m, clusters) -> (rows, yaw_rad, score)`. Both take the lock; the ladder around them does not have it.
Describe by_python(nb::object&& describe, std::size_t templates) {
  return [described = held(std::move(describe)), templates](const QueriedScan&, const LevelledScan& levelled) {
    const nb::gil_scoped_acquire lock;
    std::vector<double> R;
    for (const auto& row : levelled.R_level_sensor) R.insert(R.end(), row.begin(), row.end());
    auto find = held((*described)(levelled.scan, array_of(std::move(R), {3, 3}), levelled.height_m, levelled.is_as_measured));
    return FindTemplates([find, templates](const std::optional<Sphere>& within, std::size_t clusters) {
      const nb::gil_scoped_acquire again;
      if (!within) return matches_of((*find)(nb::none(), 0.0, clusters), templates);
      const auto& [x_m, y_m, z_m] = within->centre_m;
      return matches_of((*find)(array_of(std::vector<double>{x_m, y_m, z_m}), within->radius_m, clusters), templates);
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

detail::Vector3 direction_of(const Direction& given) {
  const detail::Vector3 made{given(0), given(1), given(2)};
  const double length2 = detail::dot(made, made);
  require(length2 > 1e-12 && length2 < 1e18, "up has no direction");
  return made;
}

// A query with its search in one map, and what both refer to.
class BoundMapSearch {
 public:
  BoundMapSearch(const SearchedMap& map, nb::object retrieval, const std::vector<Viewed>& viewed, const std::vector<Described>& described,
                 const Scanned& dense, const Scanned& sparse, std::size_t spots, const SearchOptions& options)
      : retrieval_(retrieval), described_(described), query_(query_of(viewed, dense, sparse, spots)) {
    require(described_.size() == viewed.size(), "there is not one levelling for each scan");
    std::vector<QueriedScan> scans;
    for (std::size_t i = 0; i < described_.size(); ++i) scans.push_back(queried(described_[i], query_.scans[i].T_last_scan));
    Describe describe = describe_of(std::move(retrieval), map);
    without_gil([&] { search_.emplace(map, query_, std::move(scans), std::move(describe), options); });
  }

  MapSearch& search() { return *search_; }
  const MapSearch& search() const { return *search_; }

 private:
  QueriedScan queried(const Described& one, const PoseMatrix& T_last_scan) const {
    const auto& [levelling, seen, occupancy, points, normals] = one;
    const auto& [R_level_sensor, height_m] = levelling;
    require(normals.shape(0) == points.shape(0), "there is not one normal for each point");
    require(std::fabs(height_m) < 1e6, "the height of a sensor is too large");
    QueriedScan made{{T_last_scan, {}, {points.data(), normals.data(), points.shape(0)}}, height_m, vectors_of(seen), nullptr};
    for (std::size_t i = 0; i < 9; ++i) made.measured.R_level_sensor[i / 3][i % 3] = R_level_sensor.data()[i];
    if (occupancy && nb::isinstance<CascadeTables>(retrieval_)) {
      made.occupancy = nb::cast<const CascadeTables*>(retrieval_)->checked(*occupancy);
    }
    return made;
  }

  nb::object retrieval_;
  std::vector<Described> described_;
  SearchedQuery query_;
  std::optional<MapSearch> search_;
};

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
  nb::class_<BoundMapSearch>(module, "MapSearch")
      .def(
          "__init__",
          [](BoundMapSearch* place, const SearchedMap& map, nb::object retrieval, const std::vector<Viewed>& scans,
             const std::vector<Described>& described, const Scanned& dense, const Scanned& sparse, std::size_t spots,
             std::optional<PriorNumbers> prior, std::optional<Direction> gravity, Direction up_by_mounting,
             std::optional<std::size_t> max_candidates, std::optional<double> asked, double left_s) {
            require(!max_candidates || (*max_candidates >= 1 && *max_candidates <= kMostCandidates), "max_candidates is out of range");
            SearchOptions options{prior_of(prior), std::nullopt, direction_of(up_by_mounting), max_candidates,
                                  asked.value_or(std::numeric_limits<double>::quiet_NaN()), Deadline::after_s(left_s)};
            if (gravity) options.gravity = direction_of(*gravity);
            new (place) BoundMapSearch(map, std::move(retrieval), scans, described, dense, sparse, spots, options);
          },
          nb::keep_alive<1, 2>(), "map"_a, "retrieval"_a, "scans"_a, "described"_a, "dense"_a, "sparse"_a, "spots"_a, "prior"_a.none(),
          "gravity"_a.none(), "up_by_mounting"_a, "max_candidates"_a.none(), "asked"_a.none(), "left_s"_a)
      .def("take",
           [](BoundMapSearch& bound, Step step) { return timed([&](StageTimes& times) { bound.search().take(step, times); }); },
           "step"_a)
      .def("may_fit",
           [](BoundMapSearch& bound, double inlier_ratio) {
             StageTimes times;
             return without_gil([&] { return bound.search().may_fit(inlier_ratio, times); });
           },
           "inlier_ratio"_a)
      .def("found", [](const BoundMapSearch& bound) { return found_in(bound.search().found()); })
      .def_prop_ro("outside_lead", [](const BoundMapSearch& bound) { return bound.search().outside_lead(); })
      .def_prop_ro("taken", [](const BoundMapSearch& bound) { return bound.search().taken(); })
      .def("is_settled", [](const BoundMapSearch& bound) { return bound.search().is_settled(); });
  module.def(
      "search_maps",
      [](const std::vector<BoundMapSearch*>& bound, bool is_one_likely) {
        std::vector<MapSearch*> searches;
        for (BoundMapSearch* const one : bound) {
          require(one != nullptr, "a search is None");
          searches.push_back(&one->search());
        }
        return timed([&](StageTimes& times) { search_maps(searches, is_one_likely, times); });
      },
      "searches"_a, "is_one_likely"_a);
  module.def(
      "similar_places",
      [](const SearchedMap& map, nb::object retrieval, Levelling levelling, Bits occupancy, std::optional<PriorNumbers> prior,
         std::size_t most, std::size_t clusters) {
        const auto& [R_level_sensor, height_m] = levelling;
        require(std::fabs(height_m) < 1e6, "the height of a sensor is too large");
        QueriedScan scan{{kSameFrame, {}, {}}, height_m, {}, occupancy.data()};
        for (std::size_t i = 0; i < 9; ++i) scan.measured.R_level_sensor[i / 3][i % 3] = R_level_sensor.data()[i];
        if (nb::isinstance<CascadeTables>(retrieval)) nb::cast<const CascadeTables*>(retrieval)->checked(occupancy);
        const Describe describe = describe_of(std::move(retrieval), map);
        const std::optional<PriorRegion> region = prior_of(prior);
        return arrays_of(without_gil([&] {
          const LevelledScan levelled{0, scan.measured.R_level_sensor, height_m, true};
          return similar_places(*map.places, map.spacing_m, describe(scan, levelled), kSameFrame, levelled, region, {most, clusters});
        }));
      },
      "map"_a, "retrieval"_a, "levelling"_a, "occupancy"_a, "prior"_a.none(), "most"_a, "clusters"_a);
  module.def(
      "expected_s",
      [](Step step, nb::handle search, double narrow_s) { return expected_s(step, effort_of(search), narrow_s); }, "step"_a, "search"_a,
      "narrow_s"_a);
}

}  // namespace firstfix::python
