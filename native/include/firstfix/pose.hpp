// A rigid pose as position and quaternion.
#pragma once

#include <array>
#include <cmath>

namespace firstfix {

// T_a_b brings a point from frame b to frame a.
struct Pose {
  std::array<double, 3> position{};             // m
  std::array<double, 4> quaternion{0, 0, 0, 1};  // x, y, z, w
};

namespace detail {

inline bool usable(const Pose& pose) {
  double length2 = 0;
  for (const double v : pose.quaternion) length2 += v * v;
  bool ok = std::isfinite(length2) && length2 > 1e-18;
  for (const double v : pose.position) ok = ok && std::isfinite(v);
  return ok;
}

// The same pose, its quaternion with length 1 and w >= 0.
inline Pose normalised(Pose pose) {
  double length2 = 0;
  for (const double v : pose.quaternion) length2 += v * v;
  const double length = std::copysign(std::sqrt(length2), std::signbit(pose.quaternion[3]) ? -1.0 : 1.0);
  for (double& v : pose.quaternion) v /= length;
  return pose;
}

}  // namespace detail
}  // namespace firstfix
