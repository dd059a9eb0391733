// The surfaces that a vertical line meets. The height of each is computed from its triangle alone, so it is the same to
// the last bit whatever else the mesh has.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/simulation/triangle_tree.hpp"

namespace firstfix {

struct Crossing {
  double z;
  float level;  // |z| of the triangle's unit normal: 1 is level
};

namespace detail {

// Adds the crossing of the line through (x, y) with a triangle of a leaf. An edge belongs to both of its triangles.
inline void cross_triangle(const TriangleTree::Leaf& leaf, int number, double x, double y,
                           std::vector<Crossing>& found) {
  double at[3][3];
  for (int k = 0; k < 3; ++k) {
    at[k][0] = static_cast<double>(leaf.corner[k][0][number]) - x;
    at[k][1] = static_cast<double>(leaf.corner[k][1][number]) - y;
    at[k][2] = static_cast<double>(leaf.corner[k][2][number]);
  }
  double weight[3];
  for (int k = 0; k < 3; ++k) {
    const double *b = at[(k + 1) % 3], *c = at[(k + 2) % 3];
    weight[k] = b[0] * c[1] - b[1] * c[0];
  }
  const bool inside = (weight[0] >= 0 && weight[1] >= 0 && weight[2] >= 0) ||
                      (weight[0] <= 0 && weight[1] <= 0 && weight[2] <= 0);
  const double whole = weight[0] + weight[1] + weight[2];
  if (!inside || whole == 0) return;  // no triangle that stands upright
  double along[2][3];
  for (int k = 0; k < 2; ++k) {
    for (int a = 0; a < 3; ++a) along[k][a] = at[k + 1][a] - at[0][a];
  }
  double squared = 0, up = 0;
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    const double n = along[0][b] * along[1][c] - along[0][c] * along[1][b];
    squared += n * n;
    if (a == 2) up = std::fabs(n);
  }
  const double z = (weight[0] * at[0][2] + weight[1] * at[1][2] + weight[2] * at[2][2]) / whole;
  if (squared > 0) found.push_back({z, static_cast<float>(up / std::sqrt(squared))});
}

}  // namespace detail

// Crossings of the vertical line through (x, y), highest first, `most` at most. One that is less than `apart_m` below the
// one before it counts as the same surface.
inline void cross_column(const TriangleTree& tree, double x, double y, double apart_m, std::size_t most,
                         std::vector<Crossing>& found) {
  found.clear();
  walk(
      tree,
      [&](const TriangleTree::Node& node) {
        std::uint32_t over = 0;
        for (int i = 0; i < TriangleTree::kWidth; ++i) {
          const bool is_over =
              node.low[0][i] <= x && x <= node.high[0][i] && node.low[1][i] <= y && y <= node.high[1][i];
          over |= static_cast<std::uint32_t>(is_over) << i;
        }
        return over;
      },
      [&](const TriangleTree::Leaf& leaf) {
        for (int i = 0; i < leaf.count; ++i) detail::cross_triangle(leaf, i, x, y, found);
        return true;
      });
  std::sort(found.begin(), found.end(),
            [](const Crossing& a, const Crossing& b) { return a.z > b.z || (a.z == b.z && a.level > b.level); });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < found.size() && kept < most; ++i) {
    if (kept == 0 || found[kept - 1].z - found[i].z >= apart_m) found[kept++] = found[i];
  }
  found.resize(kept);
}

}  // namespace firstfix
