// Points with the times at which they were taken, where these are known: numbers in a row, as kernels take them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix {

// The (count) times of a scan's points, or null where they cannot show a motion: a flash, or all zeros.
inline const float* sweep_times(const float* time_s, std::size_t count) {
  constexpr double kMinSweepS = 0.005;  // from the first to the last: in less, nothing moves far enough to be seen
  if (time_s == nullptr || count == 0) return nullptr;
  const auto [first, last] = std::minmax_element(time_s, time_s + count);
  return static_cast<double>(*last - *first) < kMinSweepS ? nullptr : time_s;
}

namespace detail {

using Rows = std::vector<std::int64_t>;

template <class To = void, class From>
auto numbers_at(const From* numbers, const Rows& rows) {
  using Number = std::conditional_t<std::is_void_v<To>, From, To>;
  std::vector<Number> made(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) made[i] = static_cast<Number>(numbers[rows[i]]);
  return made;
}

template <class To = void, class From>
auto vectors_at(const From* vectors, const Rows& rows) {
  using Number = std::conditional_t<std::is_void_v<To>, From, To>;
  std::vector<Number> made(3 * rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) made[3 * i + axis] = static_cast<Number>(vectors[3 * rows[i] + axis]);
  }
  return made;
}

}  // namespace detail

struct PointsInTime {
  std::vector<float> points, time_s;  // (n, 3), and (n) or none

  std::size_t size() const { return points.size() / 3; }
  const float* times() const { return time_s.empty() ? nullptr : time_s.data(); }

  // Those of (count, 3) points whose distance from the origin lies between two limits. time_s: (count), or null.
  static PointsInTime within_range(const float* points, const float* time_s, std::size_t count, double min_range_m,
                                   double max_range_m) {
    PointsInTime near;
    near.points.reserve(3 * count);
    each_within_range(points, count, min_range_m, max_range_m, [&near](const float* some, std::size_t number) {
      near.points.insert(near.points.end(), some, some + 3 * number);
    });
    if (time_s == nullptr) return near;
    near.time_s.reserve(near.size());
    for (std::size_t i = 0; i < count; ++i) {
      if (is_within_range(points + 3 * i, min_range_m, max_range_m)) near.time_s.push_back(time_s[i]);
    }
    return near;
  }

  PointsInTime rows(const detail::Rows& rows) const {
    PointsInTime made{detail::vectors_at(points.data(), rows), {}};
    if (!time_s.empty()) made.time_s = detail::numbers_at(time_s.data(), rows);
    return made;
  }

  // At most `count` of them, in their order (rows_by_chance).
  PointsInTime at_most(std::size_t count) const {
    if (size() <= count) return *this;
    if (!time_s.empty()) return rows(detail::rows_by_chance(size(), count));
    PointsInTime made;
    made.points.resize(3 * count);
    chosen_by_chance(points.data(), size(), count, made.points.data());
    return made;
  }
};

}  // namespace firstfix
