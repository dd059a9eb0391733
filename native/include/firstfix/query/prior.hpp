// Where the caller knows the robot to be.
#pragma once

#include <cmath>
#include <cstddef>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/retrieval/candidates.hpp"

namespace firstfix {

// firstfix.answer.prior.Prior, for poses in a map's level frame: a sphere that contains the sensor, and the headings of its x
// axis.
struct PriorRegion {
  PoseMatrix T_map_level;
  detail::Vector3 position_m;  // in the map's own frame
  double radius_m, yaw_deg, yaw_range_deg;

  // The middle in the level frame.
  detail::Vector3 middle_on_level_m() const {
    detail::Vector3 made{};
    for (std::size_t row = 0; row < 3; ++row) {
      for (std::size_t k = 0; k < 3; ++k) made[row] += T_map_level[4 * k + row] * (position_m[k] - T_map_level[4 * k + 3]);
    }
    return made;
  }

  // Whether a pose agrees with the prior, with slack for one that is not registered yet.
  bool allows(const PoseMatrix& T_level_sensor, double slack_m = 0, double slack_deg = 0) const {
    double away2 = 0;
    for (std::size_t row = 0; row < 3; ++row) {
      double at_m = 0;
      for (std::size_t k = 0; k < 4; ++k) at_m += T_map_level[4 * row + k] * T_level_sensor[4 * k + 3];
      away2 += (at_m - position_m[row]) * (at_m - position_m[row]);
    }
    return std::sqrt(away2) <= radius_m + slack_m &&
           HeadingPrior{T_map_level, yaw_deg, yaw_range_deg + slack_deg}.allows(T_level_sensor);
  }
};

}  // namespace firstfix
