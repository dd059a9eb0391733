// Ranges of the rays of one sensor pose to a mesh. Sixteen neighbouring rays go through the tree together.
//
// Every ray is tested against a triangle with the same arithmetic, whatever rays go with it: by the planes through the
// origin and the triangle's edges (Plücker coordinates), as Embree does. Neighbouring triangles see their common edge's
// plane with exactly opposite signs, so no ray slips between them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/simulation/ray_bundles.hpp"
#include "firstfix/simulation/triangle_tree.hpp"

namespace firstfix {
namespace detail {

constexpr float kSlack = 1e-4F;  // of a pyramid's sides, against rounding
constexpr int kFewRays = 5;  // as many are quicker one by one, each against all triangles of a leaf
constexpr std::size_t kOrigins = 16;  // at a time

// Sixteen rays and the pyramid around them.
struct Bundle {
  F16 x, y, z;           // directions
  F16 over_x, over_y, over_z;
  F16 beyond;            // what is not further than this does not count
  F16 range;             // least range so far
  float side[4][3];      // inward normals of the pyramid's sides, through the origin
};

// The eight triangles of a leaf, seen from the origin: normals of the planes through their edges, their own normal, and
// their distance along it.
struct SeenLeaf {
  F8 edge[3][3], normal[3], away;
};

inline SeenLeaf seen_from(const TriangleTree::Leaf& leaf, const float* origin) {
  F8 v[3][3];
  for (int corner = 0; corner < 3; ++corner) {
    for (int a = 0; a < 3; ++a) v[corner][a] = F8::at(leaf.corner[corner][a]) - F8(origin[a]);
  }
  SeenLeaf seen;
  F8 along[3][3];
  for (int k = 0; k < 3; ++k) {
    const int from = k, to = (k + 1) % 3;
    F8 sum[3];
    for (int a = 0; a < 3; ++a) {
      along[k][a] = v[to][a] - v[from][a];
      sum[a] = v[to][a] + v[from][a];
    }
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, c = (a + 2) % 3;
      seen.edge[k][a] = along[k][b] * sum[c] - along[k][c] * sum[b];
    }
  }
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    seen.normal[a] = along[0][b] * along[1][c] - along[0][c] * along[1][b];
  }
  seen.away = seen.normal[0] * v[0][0] + seen.normal[1] * v[0][1] + seen.normal[2] * v[0][2];
  return seen;
}

// The ranges of rays to triangles beyond `beyond`, `best` where they are missed or further than that. Rays or triangles
// are many.
template <int N>
inline Wide<N> nearer(const Wide<N>& u, const Wide<N>& v, const Wide<N>& w, const Wide<N>& along, const Wide<N>& away,
                      const Wide<N>& beyond, const Wide<N>& best) {
  const Wide<N> zero(0);
  const auto inside = (zero <= least(least(u, v), w)) | (most(most(u, v), w) <= zero);
  const Wide<N> range = away / along;
  return choose(inside & (beyond < range) & (range < best), range, best);
}

inline void meet_leaf(const TriangleTree::Leaf& leaf, const float* origin, std::uint32_t rays, Bundle& bundle) {
  const SeenLeaf seen = seen_from(leaf, origin);
  if (__builtin_popcount(rays) <= kFewRays) {
    for (; rays; rays &= rays - 1) {
      const int i = __builtin_ctz(rays);
      const float x = bundle.x[i], y = bundle.y[i], z = bundle.z[i];
      const auto dot = [&](const F8(&n)[3]) { return n[0] * F8(x) + n[1] * F8(y) + n[2] * F8(z); };
      const F8 ranges = nearer<8>(dot(seen.edge[0]), dot(seen.edge[1]), dot(seen.edge[2]), dot(seen.normal), seen.away,
                                  bundle.beyond[i], bundle.range[i]);
      bundle.range.set(i, least_of(ranges));
    }
    return;
  }
  for (int i = 0; i < leaf.count; ++i) {
    const auto dot = [&](const F8(&n)[3]) {
      return F16(n[0][i]) * bundle.x + F16(n[1][i]) * bundle.y + F16(n[2][i]) * bundle.z;
    };
    bundle.range = nearer<16>(dot(seen.edge[0]), dot(seen.edge[1]), dot(seen.edge[2]), dot(seen.normal), seen.away[i],
                              bundle.beyond, bundle.range);
  }
}

// The boxes of a node's children, seen from the origin.
struct SeenBoxes {
  float low[3][TriangleTree::kWidth], high[3][TriangleTree::kWidth];
};

// Which rays meet a child's box.
inline std::uint32_t rays_to(const SeenBoxes& boxes, int child, const Bundle& bundle) {
  const F16* over[3] = {&bundle.over_x, &bundle.over_y, &bundle.over_z};
  F16 enter(0), leave = bundle.range;
  for (int a = 0; a < 3; ++a) {
    const F16 first = F16(boxes.low[a][child]) * *over[a];
    const F16 second = F16(boxes.high[a][child]) * *over[a];
    enter = most(least(first, second), enter);
    leave = least(most(first, second), leave);
  }
  return bits_of(enter <= leave * F16(1 + 4e-6F));
}

// Sixteen rays of the given rows of directions, and the pyramid around them. The last ray fills up.
inline Bundle bundle_of(Vectors<const float> directions, Span<const std::uint32_t> rows, float max_range_m) {
  Bundle bundle;
  float axis[3] = {0, 0, 0};
  for (int i = 0; i < static_cast<int>(kBundle); ++i) {
    const float* d = directions[rows[std::min(static_cast<std::size_t>(i), rows.size - 1)]];
    bundle.x.set(i, d[0]), bundle.y.set(i, d[1]), bundle.z.set(i, d[2]);
    for (int a = 0; a < 3; ++a) axis[a] += d[a];
  }
  const auto over = [](const F16& d) {
    const F16 tiny(1e-20F);
    return F16(1) / choose((d < tiny) & (F16(-1e-20F) < d), tiny, d);
  };
  bundle.over_x = over(bundle.x), bundle.over_y = over(bundle.y), bundle.over_z = over(bundle.z);
  bundle.beyond = 0;
  bundle.range = max_range_m;
  // two axes across the mean direction, the first one level
  float right[3] = {-axis[1], axis[0], 0};
  float length = std::sqrt(right[0] * right[0] + right[1] * right[1]);
  if (length < 1e-3F) right[0] = length = 1, right[1] = 0;
  for (float& r : right) r /= length;
  const float up[3] = {axis[1] * right[2] - axis[2] * right[1], axis[2] * right[0] - axis[0] * right[2],
                       axis[0] * right[1] - axis[1] * right[0]};
  const F16 ahead = F16(axis[0]) * bundle.x + F16(axis[1]) * bundle.y + F16(axis[2]) * bundle.z;
  const F16 across = (F16(right[0]) * bundle.x + F16(right[1]) * bundle.y) / ahead;
  const F16 above = (F16(up[0]) * bundle.x + F16(up[1]) * bundle.y + F16(up[2]) * bundle.z) / ahead;
  const bool narrow = least_of(ahead) > 1;  // of 16: all within 86 degrees of the mean
  const float sides[4][2] = {{1, least_of(across)}, {-1, most_of(across)}, {1, least_of(above)}, {-1, most_of(above)}};
  const float spread = kSlack * (1 + std::max(most_of(across) - least_of(across), most_of(above) - least_of(above)));
  for (int k = 0; k < 4; ++k) {
    const float* out = k < 2 ? right : up;
    for (int a = 0; a < 3; ++a) {
      bundle.side[k][a] = narrow ? sides[k][0] * (out[a] - sides[k][1] * axis[a]) + spread * axis[a] : 0;
    }
  }
  return bundle;
}

// Squared distances from the origin to the boxes of a node, infinite where a box is outside of the pyramid.
inline F8 away_squared(const TriangleTree::Node& node, const float* origin, const Bundle& bundle, SeenBoxes& boxes) {
  F8 low[3], high[3], squared(0);
  for (int a = 0; a < 3; ++a) {
    low[a] = F8::at(node.low[a]) - F8(origin[a]);
    high[a] = F8::at(node.high[a]) - F8(origin[a]);
    std::memcpy(boxes.low[a], &low[a], sizeof boxes.low[a]);
    std::memcpy(boxes.high[a], &high[a], sizeof boxes.high[a]);
    const F8 gap = most(most(low[a], F8(0) - high[a]), F8(0));
    squared = squared + gap * gap;
  }
  F8 least_inward(0);
  for (const auto& side : bundle.side) {
    F8 inward(0);
    for (int a = 0; a < 3; ++a) inward = inward + F8(side[a]) * (side[a] > 0 ? high[a] : low[a]);
    least_inward = least(least_inward, inward);
  }
  return choose(least_inward < F8(0), F8(std::numeric_limits<float>::infinity()), squared);
}

inline void prefetch(const TriangleTree& tree, std::int32_t child) {
  const void* from = child < 0 ? static_cast<const void*>(&tree.leaves()[static_cast<std::size_t>(~child)])
                               : static_cast<const void*>(&tree.nodes()[static_cast<std::size_t>(child)]);
  for (int line = 0; line < 4; ++line) __builtin_prefetch(static_cast<const char*>(from) + 64 * line);
}

inline void cast_bundle(const TriangleTree& tree, const float* origin, Bundle& bundle) {
  struct Entry {
    std::int32_t child;
    std::uint32_t rays;  // that meet its box
    float squared;       // distance to its box
  };
  Entry stack[TriangleTree::kWidth * TriangleTree::kMostLevels];
  int depth = 0;
  float limit = 0;
  const auto enter = [&](std::int32_t number) {
    const TriangleTree::Node& node = tree.nodes()[static_cast<std::size_t>(number)];
    const float furthest = most_of(bundle.range);
    limit = furthest * furthest * (1 + 1e-5F);
    SeenBoxes boxes;
    const F8 squared = away_squared(node, origin, bundle, boxes);
    const int first = depth;
    for (std::uint32_t near = bits_of(squared <= F8(limit)); near; near &= near - 1) {
      const int i = __builtin_ctz(near);
      const std::uint32_t rays = rays_to(boxes, i, bundle);
      if (!rays) continue;
      prefetch(tree, node.child[i]);
      const Entry entry{node.child[i], rays, squared[i]};
      int place = depth++;  // the nearest on top
      for (; place > first && stack[place - 1].squared < entry.squared; --place) stack[place] = stack[place - 1];
      stack[place] = entry;
    }
  };
  enter(0);
  while (depth) {
    const Entry at = stack[--depth];
    if (at.squared > limit) continue;
    if (at.child >= 0) {
      enter(at.child);
    } else {
      meet_leaf(tree.leaves()[static_cast<std::size_t>(~at.child)], origin, at.rays, bundle);
    }
  }
}

}  // namespace detail

// Ranges of unit directions from one origin (3,) to what lies beyond a range of each ray's own, infinite where nothing does
// up to the limit.
inline void cast_rays_beyond(const TriangleTree& tree, const float* origin, Vectors<const float> directions,
                             const std::uint32_t* order, const float* beyond_m, float max_range_m, float* ranges) {
  const std::size_t count = directions.size;
  const float limit = std::nextafter(max_range_m, std::numeric_limits<float>::infinity());
  for (std::size_t start = 0; start < count; start += kBundle) {
    const std::size_t rays = std::min(kBundle, count - start);
    const Span<const std::uint32_t> rows{order + start, rays};
    detail::Bundle bundle = detail::bundle_of(directions, rows, limit);
    for (std::size_t i = 0; i < rays; ++i) bundle.beyond.set(static_cast<int>(i), beyond_m[rows[i]]);
    detail::cast_bundle(tree, origin, bundle);
    for (std::size_t i = 0; i < rays; ++i) {
      const float range = bundle.range[static_cast<int>(i)];
      ranges[rows[i]] = range < limit ? range : std::numeric_limits<float>::infinity();
    }
  }
}

// Ranges (origins, directions) of unit directions from each origin, infinite where nothing is met between the two
// limits. What is nearer than the first one hides what is behind it.
//
// `order` has the rows of the directions as `bundle_rays` sorts them. Origins side by side are quicker than others, for
// they meet the same part of the mesh.
inline void cast_rays(const TriangleTree& tree, Vectors<const float> origins, Vectors<const float> directions,
                      const std::uint32_t* order, float min_range_m, float max_range_m, float* ranges) {
  const std::size_t count = directions.size;
  const float beyond = std::nextafter(max_range_m, std::numeric_limits<float>::infinity());
  for (std::size_t first = 0; first < origins.size; first += detail::kOrigins) {
    const std::size_t end = std::min(first + detail::kOrigins, origins.size);
    for (std::size_t start = 0; start < count; start += kBundle) {
      const std::size_t rays = std::min(kBundle, count - start);
      const Span<const std::uint32_t> rows{order + start, rays};
      const detail::Bundle made = detail::bundle_of(directions, rows, beyond);
      for (std::size_t at = first; at < end; ++at) {
        detail::Bundle bundle = made;
        detail::cast_bundle(tree, origins[at], bundle);
        for (std::size_t i = 0; i < rays; ++i) {
          const float range = bundle.range[static_cast<int>(i)];
          const bool met = range < beyond && range >= min_range_m;
          ranges[at * count + rows[i]] = met ? range : std::numeric_limits<float>::infinity();
        }
      }
    }
  }
}

}  // namespace firstfix
