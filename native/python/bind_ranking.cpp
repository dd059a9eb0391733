#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <optional>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "firstfix/query/calibration.hpp"
#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/ranking.hpp"
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
