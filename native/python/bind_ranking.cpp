#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "firstfix/query/calibration.hpp"
#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/look_alikes.hpp"
#include "firstfix/query/ranking.hpp"
#include "firstfix/query/verdict.hpp"
#include "map_numbers.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Poses = In<double, nb::shape<-1, 4, 4>>;
using TwistArray = In<double, nb::shape<6>>;

SupportNumbers support_numbers(nb::handle numbers) {
  SupportNumbers made{};
  take_support(numbers, made);
  return made;
}

ProbabilityNumbers probability_numbers(nb::handle numbers) {
  ProbabilityNumbers made{};
  take_probability(numbers, made);
  return made;
}

// A pose that competes: number of its map, quality, support, spots, is_alike, outside_lead, rests, is_in_motion.
using Asked = std::tuple<std::size_t, nb::object, double, std::size_t, bool, double, bool, bool>;

}  // namespace

void bind_ranking(nb::module_& module) {
  using namespace nb::literals;
  module.attr("STACKED_WITHIN_M") = kStackedWithinM;
  module.attr("STOREY_M") = kStoreyM;
  module.attr("SLOW_M_S") = kSlowMS;
  module.attr("SLOW_RAD_S") = kSlowRadS;
  module.def(
      "support",
      [](nb::handle numbers, nb::handle quality) {
        return support_numbers(numbers).support(fit_of(quality));
      },
      "numbers"_a, "quality"_a);
  module.def(
      "contradiction",
      [](nb::handle numbers, nb::handle quality) {
        return support_numbers(numbers).contradiction(fit_of(quality));
      },
      "numbers"_a, "quality"_a);
  module.def(
      "discounted_score",
      [](nb::handle numbers, double alignment_score, std::optional<TwistArray> twist) {
        const KnownTwist known = twist ? KnownTwist(vector6_of(*twist)) : std::nullopt;
        return probability_numbers(numbers).discounted_score(alignment_score, known);
      },
      "numbers"_a, "alignment_score"_a, "twist"_a.none());
  module.def(
      "margin_and_tied",
      [](const std::vector<double>& supports, std::size_t one, double tied_within, double max_margin) {
        require(one < supports.size(), "there is no such pose");
        const MatchFeatures found = match_features({}, supports, one, tied_within, max_margin);
        return std::make_tuple(found.margin, found.tied);
      },
      "supports"_a, "number"_a, "tied_within"_a, "max_margin"_a);
  module.def(
      "match_inputs",
      [](nb::handle numbers, nb::handle quality, double margin) {
        const std::array<double, 5> inputs = inputs_of({fit_of(quality), margin, 1}, probability_numbers(numbers));
        return std::make_tuple(inputs[0], inputs[1], inputs[2], inputs[3], inputs[4]);
      },
      "numbers"_a, "quality"_a, "margin"_a);
  module.def(
      "probability",
      [](nb::handle calibration, nb::handle numbers, nb::handle quality, double margin, std::size_t tied) {
        return calibration_of(calibration).probability({fit_of(quality), margin, tied}, probability_numbers(numbers));
      },
      "calibration"_a, "numbers"_a, "quality"_a, "margin"_a, "tied"_a);
  module.def(
      "accepts",
      [](nb::handle calibration, nb::handle numbers, nb::handle quality, double margin, std::size_t tied, double needed) {
        return calibration_of(calibration).accepts({fit_of(quality), margin, tied}, probability_numbers(numbers), needed);
      },
      "calibration"_a, "numbers"_a, "quality"_a, "margin"_a, "tied"_a, "needed"_a);
  module.def(
      "may_lack",
      [](nb::handle numbers, double alignment_score, nb::handle place, nb::handle best) {
        return may_lack(support_numbers(numbers), alignment_score, fit_of(place), fit_of(best));
      },
      "numbers"_a, "alignment_score"_a, "place"_a, "best"_a);
  module.def(
      "is_one_thing",
      [](nb::handle numbers, nb::handle place, nb::handle best) {
        return is_one_thing(support_numbers(numbers), fit_of(place), fit_of(best));
      },
      "numbers"_a, "place"_a, "best"_a);
  module.def(
      "are_parted",
      [](In<double, nb::ndim<1>> lead, In<bool, nb::ndim<1>> is_doubtful, In<double, nb::shape<-1, 3>> at_m) {
        const std::size_t count = at_m.shape(0);
        require(lead.shape(0) == count && is_doubtful.shape(0) == count, "there is not one lead and one flag for each place");
        std::unique_ptr<bool[]> flags = memory<bool>(count);
        for (std::size_t i = 0; i < count; ++i) {
          flags[i] = is_parted(lead.data()[i], is_doubtful.data()[i], is_stacked(at_m.data(), at_m.data() + 3 * i));
        }
        return array_of(std::move(flags), {count});
      },
      "lead"_a, "is_doubtful"_a, "at_m"_a);
  module.def(
      "decided",
      [](const std::vector<std::tuple<nb::object, nb::object>>& maps, const std::vector<Asked>& ranked,
         std::optional<double> threshold) {
        std::vector<JudgingMap> judging;
        for (const auto& [ranking, calibration] : maps) {
          judging.push_back({probability_numbers(ranking), calibration_of(calibration)});
        }
        std::vector<Competitor> competitors;
        for (const auto& [map, quality, support, spots, is_alike, outside_lead, rests, is_in_motion] : ranked) {
          require(map < maps.size(), "there is no such map");
          require(std::isfinite(support) && std::isfinite(outside_lead), "a support or a lead is not finite");
          competitors.push_back({map, fit_of(quality), support, spots, is_alike, outside_lead, rests, is_in_motion});
        }
        const double asked = threshold.value_or(std::numeric_limits<double>::quiet_NaN());
        Decision found = Judge(judging, competitors).decided(asked);
        return std::make_tuple(code_of(found.why), found.probability, std::move(found.shares));
      },
      "maps"_a, "ranked"_a, "threshold"_a.none());
  module.def(
      "pose_product",
      [](In<double, nb::shape<4, 4>> a, In<double, nb::shape<4, 4>> b) {
        return array_of(std::vector<PoseMatrix>{detail::product(pose_of(a), pose_of(b))}, {4, 4});
      },
      "a"_a, "b"_a);
  module.def(
      "is_stacked",
      [](In<double, nb::shape<3>> at_m, In<double, nb::shape<-1, 3>> others_m) {
        std::unique_ptr<bool[]> flags = memory<bool>(others_m.shape(0));
        for (std::size_t i = 0; i < others_m.shape(0); ++i) flags[i] = is_stacked(at_m.data(), others_m.data() + 3 * i);
        return array_of(std::move(flags), {others_m.shape(0)});
      },
      "at_m"_a, "others_m"_a);
  module.def(
      "is_any_of",
      [](Poses poses, Poses others, double within_m, double within_rad) {
        const std::vector<PoseMatrix> those = poses_of(others);
        std::unique_ptr<bool[]> flags = memory<bool>(poses.shape(0));
        std::size_t row = 0;
        for (const PoseMatrix& T : poses_of(poses)) flags[row++] = is_any_of(T, those, within_m, std::cos(within_rad));
        return array_of(std::move(flags), {poses.shape(0)});
      },
      "T"_a, "others"_a, "within_m"_a, "within_rad"_a);
}

}  // namespace firstfix::python
