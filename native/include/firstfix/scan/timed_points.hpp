// Points with the times at which they were taken, filtered together.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/reduction.hpp"

namespace firstfix::detail {

struct TimedPoints {
  std::vector<Point> points;
  std::optional<std::vector<float>> time_s;  // one per point

  // Usable points between two distances from the sensor. Throws "invalid_scan" if there is not one time for each point.
  static TimedPoints within_range(const Scan& scan, double min_range_m, double max_range_m) {
    if (!scan.time_s) return {detail::within_range(scan.points, min_range_m, max_range_m), std::nullopt};
    if (scan.time_s->size() != scan.points.size()) {
      throw Error("invalid_scan", "the number of times is not the number of points");
    }
    TimedPoints kept{{}, std::vector<float>()};
    for (std::size_t i = 0; i < scan.points.size(); ++i) {
      if (detail::within_range({scan.points[i]}, min_range_m, max_range_m).empty()) continue;
      kept.points.push_back(scan.points[i]);
      kept.time_s->push_back((*scan.time_s)[i]);
    }
    return kept;
  }

  // At most `count` of the points, in their order.
  TimedPoints at_most(std::size_t count) const {
    TimedPoints kept{detail::at_most(points, count), std::nullopt};
    if (time_s) kept.time_s = detail::at_most(*time_s, count);
    return kept;
  }

  // In the order of voxel_means.
  std::optional<std::vector<double>> voxel_mean_times(double voxel_m) const {
    if (!time_s) return std::nullopt;
    return firstfix::voxel_mean_times(numbers_of(points), time_s->data(), points.size(), voxel_m, kBorderM);
  }
};

}  // namespace firstfix::detail
