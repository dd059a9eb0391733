// Map points in square ground tiles (firstfix.engine.verification.point_tiles): which points lie around a position.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace firstfix {

constexpr double kTileM = 5.0;

// The tables usually lie in a mapped file, and nobody has read them: a damaged one may hold any number.
struct PointTiles {
  const float* points;  // (count, 3), tile after tile in columns along y
  std::int64_t count;
  const std::int32_t* begin;  // (columns, rows + 1)
  std::int64_t columns, rows;
  std::int32_t low[2];  // the first tile

  // Calls use(first, end) for the points of each column's tiles within a distance of a centre along the ground.
  template <class Use>
  void each_run(const double* centre, double reach_m, Use use) const {
    const std::int64_t left = tile(centre[0] - reach_m, 0, columns);
    const std::int64_t right = tile(centre[0] + reach_m + kTileM, 0, columns);
    for (std::int64_t column = left; column < right; ++column) {
      const double nearest = std::clamp(centre[0], edge(column, 0), edge(column + 1, 0)) - centre[0];
      const double half = std::sqrt(std::max(reach_m * reach_m - nearest * nearest, 0.0)) + kSlackM;
      const std::int32_t* begins = begin + column * (rows + 1);
      const std::int64_t first = std::clamp<std::int64_t>(begins[tile(centre[1] - half, 1, rows)], 0, count);
      const std::int64_t end = std::clamp<std::int64_t>(begins[tile(centre[1] + half + kTileM, 1, rows)], 0, count);
      if (first < end) use(first, end);
    }
  }

 private:
  static constexpr double kSlackM = 0.1;  // for single precision, which decides whether a point is within reach

  double edge(std::int64_t tile, int axis) const { return static_cast<double>(tile + low[axis]) * kTileM; }

  // The tile at a coordinate, between 0 and `size`. What is not a number lies in tile 0.
  std::int64_t tile(double at_m, int axis, std::int64_t size) const {
    const double number = std::floor(at_m / kTileM) - static_cast<double>(low[axis]);
    return number > 0 ? static_cast<std::int64_t>(std::min(number, static_cast<double>(size))) : 0;
  }
};

}  // namespace firstfix
