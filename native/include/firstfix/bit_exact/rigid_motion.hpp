// Small motions of poses, and the distance between poses.
#pragma once

#include <cmath>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

// Turns a pose's rotation from the left by a rotation vector, (3,) radians (Rodrigues).
inline void turn_left(const double* by_rad, PoseMatrix& T) {
  const double x = by_rad[0], y = by_rad[1], z = by_rad[2];
  const double angle2 = x * x + y * y + z * z, angle = std::sqrt(angle2);
  const double s = angle < 1e-8 ? 1 - angle2 / 6 : std::sin(angle) / angle;
  const double c = angle < 1e-8 ? 0.5 - angle2 / 24 : (1 - std::cos(angle)) / angle2;
  const double turn[9] = {1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y,        //
                          c * x * y + s * z,       1 - c * (x * x + z * z), c * y * z - s * x,  //
                          c * x * z - s * y,       c * y * z + s * x, 1 - c * (x * x + y * y)};
  double R[9];
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      R[3 * row + column] = turn[3 * row] * T[column] + turn[3 * row + 1] * T[4 + column] + turn[3 * row + 2] * T[8 + column];
    }
  }
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) T[4 * row + column] = R[3 * row + column];
  }
}

// Whether two poses are nearer than a distance, and turned by less than an angle given by its cosine.
inline bool is_same_pose(const PoseMatrix& T, const PoseMatrix& other, double within_m, double cosine) {
  double distance2 = 0, trace = 0;
  for (int row = 0; row < 3; ++row) {
    const double away = T[4 * row + 3] - other[4 * row + 3];
    distance2 += away * away;
    for (int column = 0; column < 3; ++column) trace += T[4 * row + column] * other[4 * row + column];
  }
  return distance2 < within_m * within_m && (trace - 1) / 2 > cosine;
}

}  // namespace firstfix
