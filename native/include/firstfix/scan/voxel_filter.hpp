// Filters of a cloud: by range, to a number of points, to one point per voxel. Defined to the last bit
// (clients/protocol/on-the-robot.md).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <unordered_set>
#include <utility>
#include <vector>

#include "firstfix/portable/sample.hpp"
#include "firstfix/portable/vector3.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix::detail {

using Cell = std::array<std::int64_t, 3>;

inline Cell cell_of(const Vector3& p, double side) {
  return {static_cast<std::int64_t>(std::floor(p[0] / side)), static_cast<std::int64_t>(std::floor(p[1] / side)),
          static_cast<std::int64_t>(std::floor(p[2] / side))};
}

inline Vector3 vector_of(const Point& p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

struct CellBox {
  Cell lowest{}, size{1, 1, 1};

  static CellBox around(const std::vector<Cell>& cells) {
    CellBox box;
    if (cells.empty()) return box;
    Cell highest = box.lowest = cells.front();
    for (const Cell& cell : cells) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.lowest[axis] = std::min(box.lowest[axis], cell[axis]);
        highest[axis] = std::max(highest[axis], cell[axis]);
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) box.size[axis] = highest[axis] - box.lowest[axis] + 1;
    return box;
  }

  // Numbers a cell: z is the slowest index, x the fastest.
  std::int64_t number(const Cell& cell) const {
    return ((cell[2] - lowest[2]) * size[1] + (cell[1] - lowest[1])) * size[0] + (cell[0] - lowest[0]);
  }
};

}  // namespace firstfix::detail

namespace firstfix {

// Copies the (count, 3) points whose distance from the origin lies between two limits. Returns their number.
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

}  // namespace firstfix

namespace firstfix::detail {

// Usable points between two distances from the origin.
inline std::vector<Point> within_range(const std::vector<Point>& points, double min_range_m, double max_range_m) {
  const auto least = static_cast<float>(min_range_m * min_range_m);
  const auto most = static_cast<float>(max_range_m * max_range_m);
  std::vector<Point> kept;
  kept.reserve(points.size());
  for (const Point& p : points) {
    if (!usable(p)) continue;
    const float range2 = p.x * p.x + p.y * p.y + p.z * p.z;
    if (range2 > least && range2 < most) kept.push_back(p);
  }
  return kept;
}

// At most `count` of the points, in their order: see rows_by_chance.
template <typename T>
std::vector<T> at_most(const std::vector<T>& points, std::size_t count) {
  if (points.size() <= count) return points;
  std::vector<T> kept;
  kept.reserve(count);
  for (const std::size_t row : rows_by_chance(points.size(), count)) kept.push_back(points[row]);
  return kept;
}

// Ascending rows of the first point in every voxel.
inline std::vector<std::size_t> first_in_voxel(const std::vector<Point>& points, double voxel_m) {
  std::vector<Cell> cells(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) cells[i] = cell_of(vector_of(points[i]), voxel_m);
  const CellBox box = CellBox::around(cells);
  std::unordered_set<std::int64_t> seen;
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (seen.insert(box.number(cells[i])).second) rows.push_back(i);
  }
  return rows;
}

// The mean of the points in every voxel, ordered by the voxels' z, then y, then x. Coordinates are rounded to steps of
// 2^-20 m, so that their sums are exact in any order.
inline std::vector<Vector3> voxel_means(const std::vector<Point>& points, double voxel_m) {
  constexpr double kStepsAMetre = 1048576.0;
  std::vector<Cell> cells(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) cells[i] = cell_of(vector_of(points[i]), voxel_m);
  const CellBox box = CellBox::around(cells);
  std::vector<std::pair<std::int64_t, std::size_t>> order(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) order[i] = {box.number(cells[i]), i};
  std::sort(order.begin(), order.end());
  std::vector<Vector3> means;
  for (std::size_t start = 0; start < order.size();) {
    Vector3 sum{};
    std::size_t end = start;
    for (; end < order.size() && order[end].first == order[start].first; ++end) {
      const Vector3 p = vector_of(points[order[end].second]);
      for (std::size_t axis = 0; axis < 3; ++axis) sum[axis] += std::nearbyint(p[axis] * kStepsAMetre);
    }
    const double steps = static_cast<double>(end - start) * kStepsAMetre;
    means.push_back({sum[0] / steps, sum[1] / steps, sum[2] / steps});
    start = end;
  }
  return means;
}

}  // namespace firstfix::detail
