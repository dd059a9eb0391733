// Whether nothing of a mesh stands on the straight way from one point to another.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firstfix/simulation/cast_rays.hpp"
#include "firstfix/simulation/triangle_tree.hpp"
#include "firstfix/bit_exact/lanes.hpp"

namespace firstfix {

// From `start` (3,) to `end` (3,): neither end is a part of the way.
inline bool is_way_free(const TriangleTree& tree, const float* start, const float* end) {
  using detail::F8;
  float way[3], over[3];
  for (int a = 0; a < 3; ++a) {
    way[a] = end[a] - start[a];
    over[a] = 1 / (std::fabs(way[a]) < 1e-20F ? 1e-20F : way[a]);
  }
  bool is_free = true;
  walk(
      tree,
      [&](const TriangleTree::Node& node) {
        F8 enter(0), leave(1);
        for (int a = 0; a < 3; ++a) {
          const F8 first = (F8::at(node.low[a]) - F8(start[a])) * F8(over[a]);
          const F8 second = (F8::at(node.high[a]) - F8(start[a])) * F8(over[a]);
          enter = most(least(first, second), enter);
          leave = least(most(first, second), leave);
        }
        return bits_of(enter <= leave * F8(1 + 4e-6F));
      },
      [&](const TriangleTree::Leaf& leaf) {
        const detail::SeenLeaf seen = detail::seen_from(leaf, start);
        const auto dot = [&](const F8(&n)[3]) { return n[0] * F8(way[0]) + n[1] * F8(way[1]) + n[2] * F8(way[2]); };
        const F8 shares = detail::nearer<8>(dot(seen.edge[0]), dot(seen.edge[1]), dot(seen.edge[2]), dot(seen.normal),
                                            seen.away, F8(0), F8(1));
        is_free = !(detail::least_of(shares) < 1);
        return is_free;
      });
  return is_free;
}

}  // namespace firstfix
