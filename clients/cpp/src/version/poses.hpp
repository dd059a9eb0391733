// Poses as matrices, between the frame of a map and the level frame of its templates.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/pose.hpp"
#include "firstfix/query/motion_at_places.hpp"
#include "firstfix/query/prepared_query.hpp"

namespace firstfix::version {

using detail::inverse;
using detail::kSameFrame;
using detail::product;

// Position and quaternion, with w >= 0, by Shepperd's method: as firstfix.transform.quaternion_of_rows.
inline Pose pose_of(const PoseMatrix& T) {
  const double xx = T[0], yy = T[5], zz = T[10], t = xx + yy + zz;
  std::array<double, 4> q;
  if (t > std::max({xx, yy, zz})) q = {T[9] - T[6], T[2] - T[8], T[4] - T[1], 1 + t};
  else if (xx >= std::max(yy, zz)) q = {1 + 2 * xx - t, T[4] + T[1], T[8] + T[2], T[9] - T[6]};
  else if (yy >= zz) q = {T[4] + T[1], 1 + 2 * yy - t, T[9] + T[6], T[2] - T[8]};
  else q = {T[8] + T[2], T[9] + T[6], 1 + 2 * zz - t, T[4] - T[1]};
  const double size = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), length = q[3] < 0 ? -size : size;
  for (double& one : q) one /= length;
  return {{T[3], T[7], T[11]}, q};
}

// As firstfix.transform.from_quaternion.
inline PoseMatrix matrix_of(const Pose& pose) {
  const auto [x, y, z, w] = detail::normalised(pose).quaternion;
  const auto& at = pose.position;
  return {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),     at[0],
          2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),     at[1],
          2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y), at[2],
          0,                       0,                       0,                       1};
}

}  // namespace firstfix::version
