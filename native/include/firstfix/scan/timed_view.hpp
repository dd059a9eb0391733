// The returns of a range view with times, for a scan whose points are not those of which the view was made.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/scan/points_in_time.hpp"
#include "firstfix/scan/range_view.hpp"

namespace firstfix {

namespace detail {

// The mean time of the points in each column of the view; between columns that have points, by straight lines.
inline std::vector<double> column_times(const float* points, const float* time_s, std::size_t count) {
  constexpr float kColumns = kViewColumns;
  std::vector<double> sum_s(kViewColumns), mean_s(kViewColumns);
  std::vector<std::size_t> number(kViewColumns), known;
  for (std::size_t i = 0; i < count; ++i) {
    const float column = (atan2_turns(points[3 * i + 1], points[3 * i]) + 0.5F) * kColumns;
    const auto at = static_cast<std::size_t>((column > 0.0F) & (column < kColumns) ? column : 0.0F);
    sum_s[at] += static_cast<double>(time_s[i]), ++number[at];
  }
  for (std::size_t at = 0; at < kViewColumns; ++at) {
    if (number[at] == 0) continue;
    mean_s[at] = sum_s[at] / static_cast<double>(number[at]);
    known.push_back(at);
  }
  for (std::size_t at = 0; at < kViewColumns && !known.empty(); ++at) {
    const auto next = std::lower_bound(known.begin(), known.end(), at);
    if (next == known.end()) {
      mean_s[at] = mean_s[known.back()];
    } else if (*next != at) {
      if (next == known.begin()) {
        mean_s[at] = mean_s[known.front()];
      } else {
        const std::size_t before = *(next - 1);
        const double slope = (mean_s[*next] - mean_s[before]) / static_cast<double>(*next - before);
        mean_s[at] = slope * static_cast<double>(at - before) + mean_s[before];
      }
    }
  }
  return mean_s;
}

}  // namespace detail

// The returns of a view, each in the middle of its direction. Its time is the mean of those of the points in its column: a spinning
// sensor sees a column at one time. The times of any other one are spread over its columns: their mean then changes little.
//
// points, time_s: of the scan, (count, 3) and (count). nearest_m: (kDirections), not finite where nothing returned. directions:
// (kDirections, 3) unit vectors.
inline PointsInTime timed_view(const float* points, const float* time_s, std::size_t count, const float* nearest_m,
                               const float* directions) {
  const std::vector<double> column_s = detail::column_times(points, time_s, count);
  PointsInTime made;
  for (std::size_t i = 0; i < kDirections; ++i) {
    if (!std::isfinite(nearest_m[i])) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) made.points.push_back(directions[3 * i + axis] * nearest_m[i]);
    made.time_s.push_back(static_cast<float>(column_s[i % kViewColumns]));
  }
  return made;
}

}  // namespace firstfix
