// Points that a scan does not keep: those that are not finite, and those beyond the range of any scanner on a robot.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/sample.hpp"

namespace firstfix {

constexpr double kMaxAbsCoordinate = 1000.0;  // m

struct Dropped {
  std::size_t not_finite = 0, too_far = 0;
  double far_m = 0;     // median distance of those too far from the origin; 0 without one
  double spread_m = 0;  // median distance of those too far from their own middle

  std::size_t points() const { return not_finite + too_far; }
};

namespace detail {

// Of an even number of values, the mean of the two in the middle.
inline double median_of(std::vector<double> values) {
  const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), half, values.end());
  return values.size() % 2 == 1 ? *half : (*std::max_element(values.begin(), half) + *half) / 2;
}

}  // namespace detail

// Of `count` points. coordinates: calls it with the number of a point, for its three coordinates as double.
template <class Coordinates>
Dropped dropped_of(std::size_t count, const Coordinates& coordinates) {
  constexpr std::size_t kMeasured = 4096;
  constexpr double kMostM = 1e9;  // a length beyond means nothing
  using Place = std::array<double, 3>;
  Dropped made;
  std::vector<Place> all;
  for (std::size_t i = 0; i < count; ++i) {
    const Place at = coordinates(i);
    const auto is_all = [&at](auto holds) { return holds(at[0]) && holds(at[1]) && holds(at[2]); };
    if (!is_all([](double v) { return std::isfinite(v); })) ++made.not_finite;
    else if (!is_all([](double v) { return std::fabs(v) <= kMaxAbsCoordinate; })) all.push_back(at);
  }
  made.too_far = all.size();
  if (all.empty()) return made;
  std::vector<Place> far;
  for (const std::int64_t row : detail::rows_by_chance(all.size(), kMeasured)) far.push_back(all[static_cast<std::size_t>(row)]);
  const auto median_from = [&](const Place& origin) {
    std::vector<double> distances;
    for (const Place& at : far) {
      const double x = at[0] - origin[0], y = at[1] - origin[1], z = at[2] - origin[2];
      distances.push_back(std::sqrt(x * x + y * y + z * z));
    }
    return std::min(detail::median_of(std::move(distances)), kMostM);
  };
  Place middle;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::vector<double> along;
    for (const Place& at : far) along.push_back(at[axis]);
    middle[axis] = detail::median_of(std::move(along));
  }
  made.far_m = median_from({0, 0, 0}), made.spread_m = median_from(middle);
  return made;
}

}  // namespace firstfix
