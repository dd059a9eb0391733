// Choice of candidates that are not all of one spot.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firstfix {

// Poses closer than both limits are of one spot.
struct Spot {
  double distance_m, cosine;  // of the difference of their headings
  std::size_t at_most;        // poses of one spot that are chosen
};

// Rows of at most `at_most` of `count` poses, in their order. position_m: (count, 3); yaw_rad: (count,).
inline std::vector<std::int64_t> spread_out(const double* position_m, const double* yaw_rad, std::size_t count,
                                            std::size_t at_most, const Spot& spot) {
  std::vector<std::int64_t> chosen;
  for (std::size_t row = 0; row < count && chosen.size() < at_most; ++row) {
    const double* p = position_m + 3 * row;
    std::size_t beside = 0;
    for (const std::int64_t other : chosen) {
      const auto at = static_cast<std::size_t>(other);
      const double x = p[0] - position_m[3 * at], y = p[1] - position_m[3 * at + 1], z = p[2] - position_m[3 * at + 2];
      if (x * x + y * y + z * z < spot.distance_m * spot.distance_m &&
          std::cos(yaw_rad[row] - yaw_rad[at]) > spot.cosine) {
        ++beside;
      }
    }
    if (beside < spot.at_most) chosen.push_back(static_cast<std::int64_t>(row));
  }
  return chosen;
}

}  // namespace firstfix
