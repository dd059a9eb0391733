// The region and headings in which the caller knows the sensor to be.
#pragma once

#include <cmath>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

// firstfix.answer.prior.Prior, under the same names.
struct Prior {
  detail::Vector3 position_m;
  double radius_m, yaw_deg, yaw_range_deg;

  bool allows(const PoseMatrix& T_map_sensor) const {
    double away2 = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double away = T_map_sensor[4 * axis + 3] - position_m[axis];
      away2 += away * away;
    }
    const double off = std::atan2(T_map_sensor[4], T_map_sensor[0]) * (180 / detail::kPi) - yaw_deg;
    const double turned = off + 180 - 360 * std::floor((off + 180) / 360);
    return std::sqrt(away2) <= radius_m && std::fabs(turned - 180) <= yaw_range_deg;
  }
};

}  // namespace firstfix
