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

// Copies the points whose distance from the origin lies between two limits. Returns their number. `kept` has room for
// all points.
inline std::size_t within_range(const float* points, std::size_t count, double min_range_m, double max_range_m,
                                float* kept) {
  const auto least = static_cast<float>(min_range_m * min_range_m);
  const auto most = static_cast<float>(max_range_m * max_range_m);
  std::size_t found = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const float x = points[3 * i], y = points[3 * i + 1], z = points[3 * i + 2];
    const float range2 = x * x + y * y + z * z;
    float* next = kept + 3 * found;
    next[0] = x, next[1] = y, next[2] = z;
    found += static_cast<std::size_t>((range2 > least) & (range2 < most));
  }
  return found;
}

// Ascending rows of the points whose voxels have the lowest hashes; within a voxel, the first rows. At most `at_most`, or
// all rows if there are no more. The voxels have a border at kBorderM. Each point is taken for its own place, so a point
// more or less changes one point of the sample. Throws std::invalid_argument for points without a voxel.
template <class T>
std::vector<std::int64_t> rows_by_voxel_hash(const T* points, std::size_t count, double voxel_m, std::size_t at_most) {
  constexpr std::uint32_t kPrimes[3] = {19'349'663, 83'492'791, 73'856'093};
  constexpr double kMostIndex = 4503599627370496.0;  // 2^52
  std::vector<std::int64_t> rows(count < at_most ? count : at_most);
  if (count <= at_most) {
    for (std::size_t i = 0; i < count; ++i) rows[i] = static_cast<std::int64_t>(i);
    return rows;
  }
  std::vector<std::uint64_t> order(count);
  bool usable = voxel_m > 0 && count <= std::numeric_limits<std::uint32_t>::max();
  for (std::size_t i = 0; i < count; ++i) {
    std::uint32_t mixed = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double index = std::floor((static_cast<double>(points[3 * i + axis]) - kBorderM) / voxel_m);
      usable = usable && std::abs(index) <= kMostIndex;
      mixed ^= static_cast<std::uint32_t>(usable ? static_cast<std::int64_t>(index) : 0) * kPrimes[axis];
    }
    order[i] = std::uint64_t{detail::hashed(mixed)} << 32 | i;
  }
  if (!usable) {
    throw std::invalid_argument("points are not finite, or too far away for voxels of this size");
  }
  std::vector<std::uint64_t> sorted = order;
  const auto first_left = sorted.begin() + static_cast<std::ptrdiff_t>(at_most);
  std::nth_element(sorted.begin(), first_left, sorted.end());
  std::size_t found = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (order[i] < *first_left) rows[found++] = static_cast<std::int64_t>(i);
  }
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

// The mean of the points in every voxel, ordered by the voxels' z, then y, then x. Coordinates are rounded to steps of
// 2^-20 m, so that their sums are exact in any order. `border_m` is the coordinate, on every axis, of a border between
// voxels. Throws as voxel_box does.
template <class T>
std::vector<double> voxel_means(const T* points, std::size_t count, double voxel_m, double border_m) {
  constexpr double kStepsAMetre = 1048576.0;
  std::vector<double> means;
  detail::each_voxel(points, count, voxel_m, border_m, detail::kZYX, [&](const auto* first, const auto* last) {
    double sum[3] = {0, 0, 0};
    for (const auto* entry = first; entry != last; ++entry) {
      const T* p = points + 3 * static_cast<std::size_t>(entry->row);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        sum[axis] += std::nearbyint(static_cast<double>(p[axis]) * kStepsAMetre);
      }
    }
    const double steps = static_cast<double>(last - first) * kStepsAMetre;
    means.insert(means.end(), {sum[0] / steps, sum[1] / steps, sum[2] / steps});
  });
  return means;
}

// The mean time of the points in every voxel, in the order of voxel_means. Times are rounded to steps of 2^-20 s. Throws as
// voxel_box does.
template <class T>
std::vector<double> voxel_mean_times(const T* points, const float* time_s, std::size_t count, double voxel_m,
                                     double border_m) {
  constexpr double kStepsASecond = 1048576.0;
  std::vector<double> means;
  detail::each_voxel(points, count, voxel_m, border_m, detail::kZYX, [&](const auto* first, const auto* last) {
    double sum = 0;
    for (const auto* entry = first; entry != last; ++entry) {
      sum += std::nearbyint(static_cast<double>(time_s[entry->row]) * kStepsASecond);
    }
    means.push_back(sum / (static_cast<double>(last - first) * kStepsASecond));
  });
  return means;
}

namespace detail {

// Usable points between two distances from the origin.
inline std::vector<Point> within_range(const std::vector<Point>& points, double min_range_m, double max_range_m) {
  std::vector<Point> kept(points.size());
  kept.resize(firstfix::within_range(numbers_of(points), points.size(), min_range_m, max_range_m, numbers_of(kept)));
  kept.erase(std::remove_if(kept.begin(), kept.end(), [](const Point& p) { return !usable(p); }), kept.end());
  return kept;
}

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

// The voxels have a border at kBorderM.
inline std::vector<Vector3> voxel_means(const std::vector<Point>& points, double voxel_m) {
  const std::vector<double> means = firstfix::voxel_means(numbers_of(points), points.size(), voxel_m, kBorderM);
  std::vector<Vector3> vectors(means.size() / 3);
  std::copy(means.begin(), means.end(), numbers_of(vectors));
  return vectors;
}

}  // namespace detail
}  // namespace firstfix
