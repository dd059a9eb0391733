// Whether a mesh comes near to a point.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "firstfix/simulation/triangle_tree.hpp"
#include "firstfix/bit_exact/lanes.hpp"

namespace firstfix {
namespace detail {

struct Vector {
  float x, y, z;

  Vector operator-(const Vector& o) const { return {x - o.x, y - o.y, z - o.z}; }
  Vector operator+(const Vector& o) const { return {x + o.x, y + o.y, z + o.z}; }
  Vector operator*(float s) const { return {x * s, y * s, z * s}; }
  float dot(const Vector& o) const { return x * o.x + y * o.y + z * o.z; }
};

// Squared distance from the origin to a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
inline float squared_to_triangle(const Vector& a, const Vector& b, const Vector& c) {
  const Vector ab = b - a, ac = c - a;
  const float d1 = -ab.dot(a), d2 = -ac.dot(a);
  if (d1 <= 0 && d2 <= 0) return a.dot(a);
  const float d3 = -ab.dot(b), d4 = -ac.dot(b);
  if (d3 >= 0 && d4 <= d3) return b.dot(b);
  const float d5 = -ab.dot(c), d6 = -ac.dot(c);
  if (d6 >= 0 && d5 <= d6) return c.dot(c);
  const float vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  Vector nearest = a;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) {
    nearest = d1 > d3 ? a + ab * (d1 / (d1 - d3)) : a;
  } else if (vb <= 0 && d2 >= 0 && d6 <= 0) {
    nearest = d2 > d6 ? a + ac * (d2 / (d2 - d6)) : a;
  } else if (va <= 0 && d4 >= d3 && d5 >= d6) {
    const float along = d4 - d3, other = d5 - d6;
    nearest = along + other > 0 ? b + (c - b) * (along / (along + other)) : b;
  } else {
    const float whole = va + vb + vc;
    nearest = a + ab * (vb / whole) + ac * (vc / whole);
  }
  return nearest.dot(nearest);
}

}  // namespace detail

// Whether any triangle is within `radius_m` of a point (3,).
inline bool is_near_surface(const TriangleTree& tree, const float* point, float radius_m) {
  // A number even for an endless radius: the empty boxes of a node are endlessly far away, and must stay outside.
  const float limit = std::min(radius_m * radius_m, std::numeric_limits<float>::max());
  bool is_near = false;
  walk(
      tree,
      [&](const TriangleTree::Node& node) {
        std::uint32_t near = 0;
        for (int i = 0; i < TriangleTree::kWidth; ++i) {
          float squared = 0;
          for (int a = 0; a < 3; ++a) {
            const float gap = std::max({node.low[a][i] - point[a], point[a] - node.high[a][i], 0.0F});
            squared += gap * gap;
          }
          near |= static_cast<std::uint32_t>(squared <= limit) << i;
        }
        return near;
      },
      [&](const TriangleTree::Leaf& leaf) {
        for (int i = 0; i < leaf.count && !is_near; ++i) {
          detail::Vector corner[3];
          for (int k = 0; k < 3; ++k) {
            corner[k] = {leaf.corner[k][0][i] - point[0], leaf.corner[k][1][i] - point[1],
                         leaf.corner[k][2][i] - point[2]};
          }
          is_near = detail::squared_to_triangle(corner[0], corner[1], corner[2]) < limit;
        }
        return !is_near;
      });
  return is_near;
}

}  // namespace firstfix
