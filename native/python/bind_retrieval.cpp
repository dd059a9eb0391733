#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <optional>
#include <tuple>

#include "arrays.hpp"
#include "cascade_tables.hpp"
#include "firstfix/retrieval/candidates.hpp"
#include "firstfix/retrieval/nearest_in_lists.hpp"
#include "firstfix/retrieval/spread_out.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Position = In<double, nb::shape<3>>;

auto arrays_of(Matches&& found) {
  return std::make_tuple(array_of(std::move(found.rows)), array_of(std::move(found.yaw_rad)),
                         array_of(std::move(found.score)));
}

detail::Vector3 vector_of(const Position& position) { return {position(0), position(1), position(2)}; }

}  // namespace

void bind_retrieval(nb::module_& module) {
  module.def(
      "nearest_in_lists",
      [](In<float, nb::shape<-1, -1>> queries, In<std::int64_t, nb::shape<-1, -1>> probed, In<float, nb::shape<-1, -1>> keys,
         In<std::int64_t, nb::shape<-1>> start, std::size_t most) {
        const std::size_t count = queries.shape(0), numbers = queries.shape(1), known = keys.shape(0);
        require(probed.shape(0) == count, "there is not one row of lists for each query");
        require(keys.shape(1) == numbers, "a query has not as many numbers as a key");
        require(known < std::size_t{1} << 32, "there are too many keys");
        require(start.shape(0) > 0 && start.data()[0] == 0 && std::is_sorted(start.data(), start.data() + start.shape(0)) &&
                    start.data()[start.shape(0) - 1] == static_cast<std::int64_t>(known),
                "the lists do not hold every key once");
        const auto lists = static_cast<std::int64_t>(start.shape(0) - 1);
        require(std::all_of(probed.data(), probed.data() + probed.size(), [&](auto list) { return 0 <= list && list < lists; }),
                "there is no such list");
        require(0 < most && most <= known, "more are wanted than there are keys, or none");
        std::vector<std::int64_t> found(count * most);
        without_gil([&] {
          nearest_in_lists({keys.data(), numbers, start.data(), start.shape(0) - 1}, queries.data(), count, probed.data(),
                           probed.shape(1), most, found.data());
        });
        return array_of(std::move(found), {count, most});
      },
      nb::arg("queries"), nb::arg("probed"), nb::arg("keys"), nb::arg("start"), nb::arg("most"));
  module.def(
      "spread_out",
      [](In<double, nb::shape<-1, 3>> position_m, In<double, nb::shape<-1>> yaw_rad, std::size_t at_most, double spot_m,
         double spot_cosine, std::size_t at_most_a_spot) {
        const std::size_t count = position_m.shape(0);
        require(yaw_rad.shape(0) == count, "a pose has one position and one yaw");
        return array_of(without_gil([&] {
          return spread_out(position_m.data(), yaw_rad.data(), count, at_most, {spot_m, spot_cosine, at_most_a_spot});
        }));
      },
      nb::arg("position_m"), nb::arg("yaw_rad"), nb::arg("at_most"), nb::arg("spot_m"), nb::arg("spot_cosine"),
      nb::arg("at_most_a_spot"));
  nb::class_<CascadeTables>(module, "Cascade")
      .def(nb::init<In<float, nb::shape<-1, 3>>, In<std::uint8_t, nb::ndim<2>>, std::size_t, std::size_t, double, Edges,
                    std::size_t, Table, Table, Table, Table, In<std::int32_t, nb::ndim<2>>, In<std::int32_t, nb::shape<2>>,
                    std::optional<In<float, nb::ndim<2>>>, In<std::uint8_t, nb::ndim<2>>, In<float, nb::ndim<1>>,
                    In<float, nb::ndim<1>>>(),
           nb::arg("position_m").noconvert(), nb::arg("occupancy").noconvert(), nb::arg("rings"), nb::arg("sectors"),
           nb::arg("max_range_m"), nb::arg("edges_m"), nb::arg("coefficients"), nb::arg("representative").noconvert(), nb::arg("start").noconvert(),
           nb::arg("member").noconvert(), nb::arg("tile_row").noconvert(), nb::arg("tile_begin").noconvert(),
           nb::arg("tile_low").noconvert(), nb::arg("projection").noconvert().none(), nb::arg("codes").noconvert(),
           nb::arg("lowest"), nb::arg("range"))
      .def(
          "search",
          [](const CascadeTables& cascade, Bits occupancy, std::size_t most) {
            const std::uint8_t* bits = cascade.checked(occupancy);
            return arrays_of(without_gil([&] { return cascade.view.search(bits, most); }));
          },
          nb::arg("occupancy"), nb::arg("most"))
      .def(
          "search_near",
          [](const CascadeTables& cascade, Bits occupancy, Position centre, double radius_m, std::size_t most) {
            const std::uint8_t* bits = cascade.checked(occupancy);
            const detail::Vector3 middle = vector_of(centre);
            return arrays_of(without_gil([&] { return cascade.view.search_near(bits, middle, radius_m, most); }));
          },
          nb::arg("occupancy"), nb::arg("centre"), nb::arg("radius_m"), nb::arg("most"));
  module.def(
      "candidates_of",
      [](In<std::int64_t, nb::ndim<1>> rows, In<double, nb::ndim<1>> yaw_rad, In<float, nb::ndim<1>> score,
         In<float, nb::shape<-1, 3>> position_m, In<float, nb::ndim<1>> height_m, In<double, nb::shape<3, 3>> R_level_sensor,
         double sensor_height_m, In<double, nb::shape<4, 4>> T_scan_last,
         std::optional<std::tuple<In<double, nb::shape<4, 4>>, double, double>> headings, std::size_t most,
         std::optional<std::tuple<double, double, std::size_t>> spot) {
        const std::size_t count = rows.shape(0);
        require(yaw_rad.shape(0) == count && score.shape(0) == count, "a match has one row, one yaw and one score");
        require(position_m.shape(0) == height_m.shape(0), "a template has one position and one height");
        const auto known = static_cast<std::int64_t>(height_m.shape(0));
        require(std::all_of(rows.data(), rows.data() + count, [&](auto row) { return 0 <= row && row < known; }),
                "the row of a template is out of range");
        const Matches matches{{rows.data(), rows.data() + count},
                              {yaw_rad.data(), yaw_rad.data() + count},
                              {score.data(), score.data() + count}};
        LevelledFrame scan{{}, sensor_height_m, pose_of(T_scan_last)};
        for (std::size_t i = 0; i < 9; ++i) scan.R_level_sensor[i / 3][i % 3] = R_level_sensor.data()[i];
        std::optional<HeadingPrior> prior;
        if (headings) prior = HeadingPrior{pose_of(std::get<0>(*headings)), std::get<1>(*headings), std::get<2>(*headings)};
        std::optional<Spot> limit;
        if (spot) limit = Spot{std::get<0>(*spot), std::get<1>(*spot), std::get<2>(*spot)};
        Candidates made = without_gil([&] {
          return candidates_of(matches, position_m.data(), height_m.data(), scan, prior ? &*prior : nullptr, most,
                               limit ? &*limit : nullptr);
        });
        const std::size_t left = made.templates.size();
        return std::make_tuple(array_of(std::move(made.templates)), array_of(std::move(made.T_level_sensor), {left, 4, 4}),
                               array_of(std::move(made.score)));
      },
      nb::arg("rows"), nb::arg("yaw_rad"), nb::arg("score"), nb::arg("position_m").noconvert(),
      nb::arg("height_m").noconvert(), nb::arg("R_level_sensor"), nb::arg("sensor_height_m"), nb::arg("T_scan_last"),
      nb::arg("headings").none(), nb::arg("most"), nb::arg("spot").none());
}

}  // namespace firstfix::python
