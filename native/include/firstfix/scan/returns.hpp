// Returns of a scan with the times at which they were measured, and filters that keep them together.
#pragma once

#include <algorithm>
#include <cstddef>

#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/scan/kept_memory.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix {

// In memory that another object owns: (count, 3) metres, and one time for each in seconds from the stamp; null: not known.
struct Returns {
  const float* points = nullptr;
  const float* time_s = nullptr;
  std::size_t count = 0;
};

namespace detail {

// What it gives is valid until it filters again.
class ReturnFilter {
 public:
  // The usable ones between two distances from the sensor.
  Returns within_range(const Returns& all, double min_range_m, double max_range_m) {
    float* const points = points_.of(3 * all.count);
    if (all.time_s == nullptr && max_range_m <= kMaxAbsCoordinate) {  // all of them are usable
      return {points, nullptr, firstfix::within_range(all.points, all.count, min_range_m, max_range_m, points)};
    }
    float* const time_s = all.time_s == nullptr ? nullptr : time_s_.of(all.count);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < all.count; ++i) {  // of one that is not kept, the next one takes the place
      const float* p = all.points + 3 * i;
      std::copy_n(p, 3, points + 3 * kept);
      if (time_s != nullptr) time_s[kept] = all.time_s[i];
      kept += static_cast<std::size_t>(is_within_range(p, min_range_m, max_range_m) && usable(Point{p[0], p[1], p[2]}));
    }
    return {points, time_s, kept};
  }

  // At most `most` of them, in their order: see rows_by_chance.
  Returns at_most(const Returns& all, std::size_t most) {
    if (all.count <= most) return all;
    float* const points = points_.of(3 * most);
    chosen_by_chance(all.points, all.count, most, points);
    if (all.time_s == nullptr) return {points, nullptr, most};
    float* const time_s = time_s_.of(most);
    for_rows_by_chance(all.count, most, [&](std::uint64_t i, std::uint64_t row) { time_s[i] = all.time_s[row]; });
    return {points, time_s, most};
  }

 private:
  KeptMemory<float> points_, time_s_;
};

}  // namespace detail
}  // namespace firstfix
