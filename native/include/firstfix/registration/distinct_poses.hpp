// The first pose of every place in a ranked list.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/rigid_motion.hpp"

namespace firstfix {

// Rows of the poses that are not nearly the same as a kept one before them; `most` rows at most.
inline std::vector<std::int64_t> distinct_poses(const std::vector<PoseMatrix>& T, double within_m, double within_rad,
                                                std::size_t most) {
  const double cosine = std::cos(within_rad);
  std::vector<std::int64_t> kept;
  for (std::size_t i = 0; i < T.size() && kept.size() < most; ++i) {
    bool is_known = false;
    for (const std::int64_t other : kept) {
      is_known = is_known || is_same_pose(T[i], T[static_cast<std::size_t>(other)], within_m, cosine);
    }
    if (!is_known) kept.push_back(static_cast<std::int64_t>(i));
  }
  return kept;
}

}  // namespace firstfix
