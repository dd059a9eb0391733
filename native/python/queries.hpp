// Directions in a query's scans, and the poses that were found for it, as Python hands them over and gets them.
#pragma once

#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "candidates.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/scan/range_view.hpp"

namespace firstfix::python {

using Points = In<float, nb::shape<-1, 3>>;
using Direction = In<double, nb::shape<3>>;
using PerDirection = In<float, nb::shape<static_cast<nb::ssize_t>(kDirections)>>;
using Doubles = nb::ndarray<nb::numpy, double>;
// A pose: row of the template, start_z_m, T_level_sensor, inlier_ratio, alignment_score, information, rests, twist,
// free_space_violation, removed_surface, seen_free, beside_surface, same_plane, is_alike, the alignment score less what an unlikely
// motion takes from it, support.
using Found = std::tuple<std::int64_t, double, Doubles, double, double, Doubles, bool, std::optional<Doubles>, double, double,
                         std::optional<double>, double, double, bool, double, double>;

inline detail::Vector3 direction_of(const Direction& given) {
  const detail::Vector3 made{given(0), given(1), given(2)};
  const double length2 = detail::dot(made, made);
  require(length2 > 1e-12 && length2 < 1e18, "up has no direction");
  return made;
}

inline std::vector<double> numbers_in(const detail::Matrix3& rows) {
  std::vector<double> numbers;
  for (const auto& row : rows) numbers.insert(numbers.end(), row.begin(), row.end());
  return numbers;
}

template <std::size_t N>
Doubles copy_of(const std::array<double, N>& numbers, std::initializer_list<std::size_t> shape) {
  return array_of(std::vector<std::array<double, N>>{numbers}, shape);
}

// Nothing: the map does not know it.
inline std::optional<double> seen_free_of(const Fit& fit) {
  return std::isnan(fit.seen_free) ? std::nullopt : std::optional(fit.seen_free);
}

inline std::vector<Found> found_in(const RegisteredPoses& poses) {
  std::vector<Found> made;
  for (const RegisteredPose& one : poses) {
    const Registration& placed = one.registration;
    const Fit& fit = one.fit;
    std::optional<Doubles> twist;
    if (placed.twist) twist = copy_of(*placed.twist, {6});
    made.emplace_back(one.template_row, one.start_z_m, copy_of(placed.T_level_sensor, {4, 4}), placed.inlier_ratio,
                      placed.alignment_score, copy_of(placed.information, {6, 6}), placed.rests, std::move(twist),
                      fit.free_space_violation, fit.removed_surface, seen_free_of(fit), fit.beside_surface, fit.same_plane, one.is_alike,
                      fit.alignment_score, one.support);
  }
  return made;
}

}  // namespace firstfix::python
