// One LiDAR scan: points in metres in the sensor frame, x forward, y left, z up (REP-103).
#pragma once

#include <cfloat>
#include <cmath>
#include <cstddef>
#include <optional>
#include <type_traits>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/dropped.hpp"
#include "firstfix/scan/time_field.hpp"

#if defined(__FAST_MATH__)
#error "firstfix needs IEEE arithmetic to produce the same bytes as other clients: do not use -ffast-math"
#endif
static_assert(FLT_EVAL_METHOD == 0, "float arithmetic must be done in float, not on the x87 unit");

namespace firstfix {

constexpr std::size_t kMaxPoints = 2'000'000;
constexpr double kMaxAbsTime = 1.0;           // s, of a point from its scan's stamp

struct Point {
  float x = 0, y = 0, z = 0;
};

// The points' numbers: x, y, z of the first one, then of the next.
static_assert(sizeof(Point) == 3 * sizeof(float) && std::is_standard_layout_v<Point>);
inline float* numbers_of(std::vector<Point>& points) { return reinterpret_cast<float*>(points.data()); }
inline const float* numbers_of(const std::vector<Point>& points) {
  return reinterpret_cast<const float*>(points.data());
}

struct Scan {
  std::vector<Point> points;
  std::optional<std::vector<float>> intensity;  // one per point
  std::optional<double> stamp_s;                // since the epoch
  std::optional<std::vector<float>> time_s{};   // one per point, in seconds from the stamp
  Dropped dropped{};                            // that a reader of messages left out
  std::optional<TimeField> time_field{};        // of the message: that gave the times, or looks like it and was not understood
};

inline bool usable(const Point& p) {
  const auto within = [](float v) { return std::fabs(static_cast<double>(v)) <= kMaxAbsCoordinate; };  // false for NaN
  return within(p.x) && within(p.y) && within(p.z);
}

namespace detail {

inline Vector3 vector_of(const Point& p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

}  // namespace detail

// The scan without points that are not finite or beyond 1000 m, which drivers deliver for "no return".
inline Scan cleaned(const Scan& scan) {
  if (scan.intensity && scan.intensity->size() != scan.points.size()) {
    throw Error("invalid_scan", "the number of intensities is not the number of points");
  }
  if (scan.time_s && scan.time_s->size() != scan.points.size()) {
    throw Error("invalid_scan", "the number of times is not the number of points");
  }
  Scan kept{{}, std::nullopt, scan.stamp_s};
  kept.points.reserve(scan.points.size());
  if (scan.intensity) kept.intensity.emplace();
  if (scan.time_s) kept.time_s.emplace();
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    if (!usable(scan.points[i])) continue;
    kept.points.push_back(scan.points[i]);
    if (scan.intensity) kept.intensity->push_back((*scan.intensity)[i]);
    if (scan.time_s) kept.time_s->push_back((*scan.time_s)[i]);
  }
  return kept;
}

}  // namespace firstfix
