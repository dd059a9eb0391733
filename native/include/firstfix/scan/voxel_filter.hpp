// Filters of a cloud: by range, to a number of points, to one point per voxel. Defined to the last bit
// (clients/protocol/on-the-robot.md). Points are x y z x y z, float or double.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/voxel_order.hpp"

namespace firstfix {

// Scanners and files round to whole millimetres: no point of theirs lies on such a border of a voxel.
constexpr double kBorderM = 0.0005;

// Whether a point's distance from the origin lies between two limits.
inline bool is_within_range(const float* point, double min_range_m, double max_range_m) {
  const auto least = static_cast<float>(min_range_m * min_range_m);
  const auto most = static_cast<float>(max_range_m * max_range_m);
  const float range2 = point[0] * point[0] + point[1] * point[1] + point[2] * point[2];
  return range2 > least && range2 < most;
}

// Calls take(points, count) with those points, in turn, whose distance from the origin lies between two limits. Most points of
// a scan lie beside others that are taken or left out with them: all of these come in one call.
template <class Take>
void each_within_range(const float* points, std::size_t count, double min_range_m, double max_range_m, Take take) {
  const auto least = static_cast<float>(min_range_m * min_range_m);
  const auto most = static_cast<float>(max_range_m * max_range_m);
  constexpr std::size_t kAtOnce = 64;
  float range2[kAtOnce], kept[3 * kAtOnce];
  std::size_t waiting = 0;  // points just before, all of which are taken
  for (std::size_t start = 0; start < count; start += kAtOnce) {
    const std::size_t some = std::min(kAtOnce, count - start);
    const float* p = points + 3 * start;
    for (std::size_t i = 0; i < some; ++i) {
      const float x = p[3 * i], y = p[3 * i + 1], z = p[3 * i + 2];
      range2[i] = x * x + y * y + z * z;
    }
    std::size_t inside = 0;
    for (std::size_t i = 0; i < some; ++i) inside += static_cast<std::size_t>((range2[i] > least) & (range2[i] < most));
    if (inside == some) {
      waiting += some;
      continue;
    }
    if (waiting > 0) take(p - 3 * waiting, waiting);
    waiting = 0;
    if (inside == 0) continue;
    std::size_t found = 0;
    for (std::size_t i = 0; i < some; ++i) {  // of a point that is not taken, the next one takes the place
      std::copy_n(p + 3 * i, 3, kept + 3 * found);
      found += static_cast<std::size_t>((range2[i] > least) & (range2[i] < most));
    }
    take(kept, found);
  }
  if (waiting > 0) take(points + 3 * (count - waiting), waiting);
}

// Copies the points whose distance from the origin lies between two limits. Returns their number. `kept` has room for
// all points.
inline std::size_t within_range(const float* points, std::size_t count, double min_range_m, double max_range_m,
                                float* kept) {
  float* end = kept;
  each_within_range(points, count, min_range_m, max_range_m,
                    [&](const float* some, std::size_t number) { end = std::copy_n(some, 3 * number, end); });
  return static_cast<std::size_t>(end - kept) / 3;
}

namespace detail {

// The value that would be at a place of the list if it were sorted. Their upper bits are even: so few values share its own.
inline std::uint64_t value_at(const std::vector<std::uint64_t>& values, std::size_t place) {
  constexpr unsigned kBits = 10;
  std::size_t counts[std::size_t{1} << kBits] = {};
  for (const std::uint64_t value : values) ++counts[value >> (64 - kBits)];
  std::uint64_t upper = 0;
  for (; place >= counts[upper]; ++upper) place -= counts[upper];
  std::vector<std::uint64_t> alike;
  alike.reserve(counts[upper]);
  for (const std::uint64_t value : values) {
    if (value >> (64 - kBits) == upper) alike.push_back(value);
  }
  const auto at = alike.begin() + static_cast<std::ptrdiff_t>(place);
  std::nth_element(alike.begin(), at, alike.end());
  return *at;
}

}  // namespace detail

// Ascending rows of the points whose voxels have the lowest hashes; within a voxel, the first rows. At most `at_most`, or
// all rows if there are no more. The voxels have a border at kBorderM. Each point is taken for its own place, so a point
// more or less changes one point of the sample. Throws std::invalid_argument for points without a voxel.
template <class T>
std::vector<std::int64_t> rows_by_voxel_hash(const T* points, std::size_t count, double voxel_m, std::size_t at_most) {
  constexpr std::uint32_t kPrimes[3] = {19'349'663, 83'492'791, 73'856'093};
  constexpr double kMostIndex = 4503599627370496.0;  // 2^52
  std::vector<std::int64_t> rows(count <= at_most ? count : 0);
  if (count <= at_most) {
    for (std::size_t i = 0; i < count; ++i) rows[i] = static_cast<std::int64_t>(i);
    return rows;
  }
  constexpr std::size_t kAtOnce = 256;
  std::vector<std::uint64_t> order(count);
  bool usable = voxel_m > 0 && count <= std::numeric_limits<std::uint32_t>::max();
  std::uint32_t mixed[kAtOnce];
  for (std::size_t start = 0; start < count && usable; start += kAtOnce) {
    const std::size_t some = std::min(kAtOnce, count - start);
    const T* from = points + 3 * start;
    std::fill_n(mixed, some, std::uint32_t{0});
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t i = 0; i < some; ++i) {
        const double index = std::floor((static_cast<double>(from[3 * i + axis]) - kBorderM) / voxel_m);
        const bool is_index = std::abs(index) <= kMostIndex;  // false for what is not a number
        usable &= is_index;
        mixed[i] ^= static_cast<std::uint32_t>(static_cast<std::int64_t>(is_index ? index : 0.0)) * kPrimes[axis];
      }
    }
    for (std::size_t i = 0; i < some; ++i) order[start + i] = std::uint64_t{detail::hashed(mixed[i])} << 32 | (start + i);
  }
  if (!usable) {
    throw std::invalid_argument("points are not finite, or too far away for voxels of this size");
  }
  const std::uint64_t first_left = detail::value_at(order, at_most);
  rows.resize(at_most + 1);  // of a row that is not taken, the next one takes the place
  std::size_t found = 0;
  for (std::size_t i = 0; i < count; ++i) {
    rows[found] = static_cast<std::int64_t>(i);
    found += static_cast<std::size_t>(order[i] < first_left);
  }
  rows.pop_back();
  return rows;
}

// Ascending rows of the first point in every voxel. Throws as voxel_box does.
template <class T>
std::vector<std::int64_t> first_in_voxel(const T* points, std::size_t count, double voxel_m) {
  std::vector<char> is_first(count);
  std::size_t voxels = 0;
  detail::each_voxel(points, count, voxel_m, 0.0, detail::kZYX, [&](const auto* first, const auto*) {
    is_first[first->row] = 1;
    ++voxels;
  });
  std::vector<std::int64_t> rows;
  rows.reserve(voxels);
  for (std::size_t i = 0; i < count; ++i) {
    if (is_first[i] != 0) rows.push_back(static_cast<std::int64_t>(i));
  }
  return rows;
}

namespace detail {

constexpr double kStepsAUnit = 1048576.0;  // of a metre, and of a second

inline double steps_of(double value) { return std::nearbyint(value * kStepsAUnit); }

}  // namespace detail

// The mean of the points in every voxel, ordered by the voxels' z, then y, then x. Coordinates are rounded to steps of
// 2^-20 m, so that their sums are exact in any order. `border_m` is the coordinate, on every axis, of a border between
// voxels. Throws as voxel_box does.
template <class T>
std::vector<double> voxel_means(const T* points, std::size_t count, double voxel_m, double border_m) {
  return detail::means_by_voxel<3>(points, count, voxel_m, border_m, detail::kStepsAUnit,
                                   [points](std::size_t row, double (&sums)[3]) {
                                     const T* p = points + 3 * row;
                                     for (std::size_t axis = 0; axis < 3; ++axis) {
                                       sums[axis] += detail::steps_of(static_cast<double>(p[axis]));
                                     }
                                   });
}

// The mean point of every voxel, as voxel_means gives it, and the mean time of its points.
struct TimedMeans {
  std::vector<double> points, time_s;  // (n, 3), (n)
};

// Times are rounded to steps of 2^-20 s. Throws as voxel_box does.
template <class T>
TimedMeans timed_voxel_means(const T* points, const float* time_s, std::size_t count, double voxel_m, double border_m) {
  const std::vector<double> means = detail::means_by_voxel<4>(
      points, count, voxel_m, border_m, detail::kStepsAUnit, [points, time_s](std::size_t row, double (&sums)[4]) {
        const T* p = points + 3 * row;
        for (std::size_t axis = 0; axis < 3; ++axis) sums[axis] += detail::steps_of(static_cast<double>(p[axis]));
        sums[3] += detail::steps_of(static_cast<double>(time_s[row]));
      });
  TimedMeans made{std::vector<double>(means.size() / 4 * 3), std::vector<double>(means.size() / 4)};
  for (std::size_t i = 0; i < made.time_s.size(); ++i) {
    std::copy_n(means.data() + 4 * i, 3, made.points.data() + 3 * i);
    made.time_s[i] = means[4 * i + 3];
  }
  return made;
}

// The mean times alone.
template <class T>
std::vector<double> voxel_mean_times(const T* points, const float* time_s, std::size_t count, double voxel_m,
                                     double border_m) {
  return timed_voxel_means(points, time_s, count, voxel_m, border_m).time_s;
}

namespace detail {

// At most `count` of the points, in their order: see rows_by_chance.
template <typename T>
std::vector<T> at_most(const std::vector<T>& points, std::size_t count) {
  if (points.size() <= count) return points;
  std::vector<T> kept;
  kept.reserve(count);
  for (const auto row : rows_by_chance(points.size(), count)) kept.push_back(points[static_cast<std::size_t>(row)]);
  return kept;
}

inline std::vector<std::int64_t> first_in_voxel(const std::vector<Point>& points, double voxel_m) {
  return firstfix::first_in_voxel(numbers_of(points), points.size(), voxel_m);
}

}  // namespace detail
}  // namespace firstfix
