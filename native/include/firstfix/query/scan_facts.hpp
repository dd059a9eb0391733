// Facts of a scan as it came, by a few of its points: they tell a wrong input from a wrong place.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/range_view.hpp"

namespace firstfix {

// rings: elevations at which the points lie, if they lie in rings. plane_ratio: thickness of the points over their breadth, as
// standard deviations; none of a few points.
struct PartFacts {
  float median_range_m, largest_range_m;
  std::optional<std::size_t> rings;
  std::optional<double> plane_ratio;
};

constexpr double kRingBinDeg = 0.1, kOneRingDeg = 1.0;
constexpr float kSharpM = 3.0F;  // from here, a centimetre is 0.2 degrees at most
constexpr std::size_t kMaxRings = 160;

namespace detail {

constexpr std::size_t kFewestWithShape = 10;  // points

// By the heights and ranges of the points. Points nearer than kSharpM do not count: the rounding of coordinates blurs their elevations.
inline std::optional<std::size_t> rings_of(Vectors<const float> points, const std::vector<float>& range_m) {
  constexpr double kFilled = 0.5;                       // of the bins between the lowest and the highest: with more, they are in no rings
  constexpr double kBins = 180 / kPi / kRingBinDeg;  // of the sine, from 0 to 1: towards the poles they are wider
  std::vector<std::size_t> bins;
  for (std::size_t i = 0; i < points.size; ++i) {
    if (!(range_m[i] >= kSharpM)) continue;
    const float sine = std::min(std::max(points[i][2] / range_m[i], -1.0F), 1.0F);
    bins.push_back(static_cast<std::size_t>(static_cast<double>(sine) * kBins + (kBins + 1)));
  }
  if (bins.size() < kFewestWithShape) return std::nullopt;
  std::sort(bins.begin(), bins.end());
  bins.erase(std::unique(bins.begin(), bins.end()), bins.end());
  const std::size_t span = bins.back() - bins.front() + 1;
  if (static_cast<double>(span) <= kOneRingDeg / kRingBinDeg) return 1;
  std::size_t rings = 1;
  for (std::size_t i = 1; i < bins.size(); ++i) rings += bins[i] - bins[i - 1] > 1 ? 1 : 0;
  const bool are_rings = static_cast<double>(bins.size()) <= kFilled * static_cast<double>(span) && rings <= kMaxRings;
  return are_rings ? std::optional(rings) : std::nullopt;
}

// Least and largest eigenvalue of a symmetric matrix, in closed form: O. K. Smith, "Eigenvalues of a symmetric 3 x 3 matrix", 1961.
inline std::pair<double, double> eigenvalue_bounds(const Matrix3& matrix) {
  const double mean = (matrix[0][0] + matrix[1][1] + matrix[2][2]) / 3;
  double a = matrix[0][0] - mean, b = matrix[1][1] - mean, c = matrix[2][2] - mean;
  double d = matrix[0][1], e = matrix[0][2], f = matrix[1][2];
  const double spread = std::sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6);
  if (!(spread > 0)) return {mean, mean};
  for (double* const one : {&a, &b, &c, &d, &e, &f}) *one /= spread;
  const double half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2;
  const double angle = std::acos(std::min(std::max(half, -1.0), 1.0)) / 3;
  return {mean + 2 * spread * std::cos(angle + 2 * kPi / 3), mean + 2 * spread * std::cos(angle)};
}

inline double plane_ratio_of(Vectors<const float> points) {
  Vector3 total{};
  Matrix3 scatter{};
  for (std::size_t i = 0; i < points.size; ++i) {
    const Vector3 at{static_cast<double>(points[i][0]), static_cast<double>(points[i][1]), static_cast<double>(points[i][2])};
    for (std::size_t row = 0; row < 3; ++row) {
      total[row] += at[row];
      for (std::size_t column = 0; column < 3; ++column) scatter[row][column] += at[row] * at[column];
    }
  }
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      scatter[row][column] -= total[row] * (total[column] / static_cast<double>(points.size));
    }
  }
  const auto [least, most] = eigenvalue_bounds(scatter);
  return std::sqrt(std::max(least, 0.0) / std::max(most, 1e-12));
}

// A middle one of the numbers, whose order changes.
inline float middle_of(std::vector<float>& numbers) {
  const auto half = numbers.begin() + static_cast<std::ptrdiff_t>(numbers.size() / 2);
  std::nth_element(numbers.begin(), half, numbers.end());
  return *half;
}

// Number of directions of the range view in which points lie, seen from a place.
inline std::size_t directions_seen(Vectors<const float> points, const std::array<float, 3>& from) {
  std::vector<float> seen(3 * points.size), nearest_m(kDirections, std::numeric_limits<float>::infinity());
  for (std::size_t i = 0; i < seen.size(); ++i) seen[i] = points.data[i] - from[i % 3];
  firstfix::nearest_by_direction(seen.data(), points.size, nearest_m.data());
  return static_cast<std::size_t>(std::count_if(nearest_m.begin(), nearest_m.end(), [](float m) { return std::isfinite(m); }));
}

// Median of points on each axis: the ground near the sensor has most of a scan's points.
inline std::array<float, 3> middle_of(Vectors<const float> points) {
  std::array<float, 3> middle;
  std::vector<float> numbers(points.size);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < points.size; ++i) numbers[i] = points[i][axis];
    middle[axis] = middle_of(numbers);
  }
  return middle;
}

}  // namespace detail

// Of a part of a scan's points, one or more, finite.
inline PartFacts scan_facts(Vectors<const float> part) {
  std::vector<float> range_m(part.size);
  for (std::size_t i = 0; i < part.size; ++i) {
    const float* p = part[i];
    range_m[i] = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
  }
  PartFacts facts{0, *std::max_element(range_m.begin(), range_m.end()), detail::rings_of(part, range_m), std::nullopt};
  if (part.size >= detail::kFewestWithShape) facts.plane_ratio = detail::plane_ratio_of(part);
  facts.median_range_m = detail::middle_of(range_m);
  return facts;
}

// Whether some hundred points of a scan lie in more directions seen from elsewhere: a quick probe, for every scan. suspect: by which
// factor more. probe_m: from the origin, towards the middle of the points.
inline bool is_spread_elsewhere(Vectors<const float> part, double suspect, double probe_m) {
  if (part.size == 0) return false;
  const double enough = suspect * static_cast<double>(detail::directions_seen(part, {0, 0, 0}));
  const std::array<float, 3> middle = detail::middle_of(part);
  if (static_cast<double>(detail::directions_seen(part, middle)) > enough) return true;
  const double step = probe_m / std::max(static_cast<double>(std::hypot(middle[0], middle[1])), 1e-3);
  const auto ahead = [&](std::size_t axis) { return static_cast<float>(static_cast<double>(middle[axis]) * step); };
  return static_cast<double>(detail::directions_seen(part, {ahead(0), ahead(1), 0})) > enough;
}

}  // namespace firstfix
