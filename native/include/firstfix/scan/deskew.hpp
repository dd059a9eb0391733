// A steady motion during a scan: points that were taken one after the other, as they are seen from one pose.
#pragma once

#include <cmath>
#include <cstddef>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

constexpr double kMaxLinearMS = 100.0, kMaxAngularRadS = 20.0;  // of a twist, along each axis

// The sensor's pose after a time, in its own frame at time 0: the exponential of the time by the twist. A twist is linear
// then angular, m/s and rad/s, in the sensor frame: whoever drives a curve has a steady one.
struct PoseAfter {
  double R[9], t[3];

  PoseAfter(const Vector6& twist, double time_s) {
    const double v[3] = {twist[0] * time_s, twist[1] * time_s, twist[2] * time_s};
    const double x = twist[3] * time_s, y = twist[4] * time_s, z = twist[5] * time_s;
    const double angle2 = x * x + y * y + z * z, angle = std::sqrt(angle2);
    const bool is_small = angle < 1e-4;
    const double a = is_small ? 1 - angle2 / 6 : std::sin(angle) / angle;
    const double b = is_small ? 0.5 - angle2 / 24 : (1 - std::cos(angle)) / angle2;
    const double c = is_small ? 1.0 / 6 - angle2 / 120 : (1 - a) / angle2;
    const double cross[9] = {0, -z, y, z, 0, -x, -y, x, 0};
    const double square[9] = {-(y * y + z * z), x * y, x * z, x * y, -(x * x + z * z), y * z, x * z, y * z, -(x * x + y * y)};
    for (int row = 0; row < 3; ++row) {
      t[row] = v[row];
      for (int column = 0; column < 3; ++column) {
        const int k = 3 * row + column;
        R[k] = (row == column ? 1 : 0) + a * cross[k] + b * square[k];
        t[row] += (b * cross[k] + c * square[k]) * v[column];
      }
    }
  }

  double turned(int axis, double x, double y, double z) const {
    return R[3 * axis] * x + R[3 * axis + 1] * y + R[3 * axis + 2] * z;
  }
};

// deskewed: as many points. time_s: one a point, from the moment for which they are wanted.
inline void deskew(Vectors<const float> points, const float* time_s, const Vector6& twist, float* deskewed) {
  for (std::size_t i = 0; i < points.size; ++i) {
    const PoseAfter pose(twist, static_cast<double>(time_s[i]));
    const float* p = points[i];
    const double x = static_cast<double>(p[0]), y = static_cast<double>(p[1]), z = static_cast<double>(p[2]);
    for (int axis = 0; axis < 3; ++axis) {
      deskewed[3 * i + axis] = static_cast<float>(pose.turned(axis, x, y, z) + pose.t[axis]);
    }
  }
}

}  // namespace firstfix
