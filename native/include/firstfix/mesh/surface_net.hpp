// The surface where the signed distance from oriented planes is zero (H. Hoppe et al., "Surface reconstruction from
// unorganized points", 1992; S. F. Gibson, "Constrained elastic surface nets", 1998).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/mesh/brick_grid.hpp"

namespace firstfix {

struct SurfaceNet {
  std::vector<double> vertices;          // x, y, z
  std::vector<std::uint32_t> triangles;  // three vertices, counter-clockwise as seen from free space
};

namespace detail {

struct Distance {
  double sum = 0, weight = 0;

  bool known() const { return weight > 0; }
  bool solid() const { return sum < 0; }
  double metres() const { return sum / weight; }
};

// The signed distance at the corners of cells: of every plane within reach, weighted by nearness and by its points.
inline BrickGrid<Distance> distances(const double* means, const double* normals, const double* weights,
                                     std::size_t count, double cell_m, double reach_cells) {
  BrickGrid<Distance> corner(Distance{});
  const double reach_m = reach_cells * cell_m;
  for (std::size_t row = 0; row < count; ++row) {
    const double* mean = means + 3 * row;
    const double* normal = normals + 3 * row;
    CellIndex low{}, high{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = static_cast<std::int32_t>(std::ceil((mean[axis] - reach_m) / cell_m));
      high[axis] = static_cast<std::int32_t>(std::floor((mean[axis] + reach_m) / cell_m));
    }
    for (std::int32_t x = low[0]; x <= high[0]; ++x) {
      for (std::int32_t y = low[1]; y <= high[1]; ++y) {
        for (std::int32_t z = low[2]; z <= high[2]; ++z) {
          const double off[3] = {x * cell_m - mean[0], y * cell_m - mean[1], z * cell_m - mean[2]};
          const double far = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]) / (reach_m * reach_m);
          if (far >= 1) continue;
          const double weight = (1 - far) * (1 - far) * weights[row];
          Distance& there = corner.at({x, y, z});
          there.sum += weight * (normal[0] * off[0] + normal[1] * off[1] + normal[2] * off[2]);
          there.weight += weight;
        }
      }
    }
  }
  return corner;
}

// The mean of the places where the surface crosses the edges of a cell, in cells from its lowest corner. False where it
// crosses none, or where a corner is out of reach of every plane.
inline bool crossing(const BrickGrid<Distance>& corner, const CellIndex& cell, std::array<double, 3>& mean) {
  Distance at[8];
  for (std::int32_t i = 0; i < 8; ++i) {
    at[i] = corner.get(beside(cell, i & 1, i >> 1 & 1, i >> 2));
    if (!at[i].known()) return false;
  }
  int number = 0;
  mean = {0, 0, 0};
  for (std::size_t i = 0; i < 8; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t end = i | std::size_t{1} << axis;
      if (end == i || at[i].solid() == at[end].solid()) continue;
      const double here = at[i].metres(), step = here - at[end].metres();
      for (std::size_t k = 0; k < 3; ++k) mean[k] += static_cast<double>(i >> k & 1);
      mean[axis] += step == 0 ? 0.5 : here / step;
      ++number;
    }
  }
  for (double& value : mean) value /= std::max(number, 1);
  return number > 0;
}

}  // namespace detail

// Rows of means, unit normals towards free space, and weights > 0. A vertex stays where one of the places near is within
// trim_cells of it. Throws as cell_of does.
inline SurfaceNet surface_net(const double* means, const double* normals, const double* weights, std::size_t count,
                              const double* near, std::size_t near_count, double cell_m, double reach_cells,
                              double trim_cells) {
  BrickGrid<std::int32_t> first(-1), vertex(-1);
  std::vector<std::int32_t> next(near_count, -1);  // rows of one cell, as a list
  std::vector<CellIndex> cells(near_count);
  for (std::size_t row = 0; row < count; ++row) cell_of(means + 3 * row, cell_m);  // throws
  for (std::size_t row = 0; row < near_count; ++row) {
    cells[row] = cell_of(near + 3 * row, cell_m);
    std::int32_t& head = first.at(cells[row]);
    next[row] = head;
    head = static_cast<std::int32_t>(row);
  }
  const auto corner = detail::distances(means, normals, weights, count, cell_m, reach_cells);
  const auto supported = [&](const CellIndex& cell, const double* at) {
    const double most = trim_cells * cell_m * (trim_cells * cell_m);
    const auto wide = static_cast<std::int32_t>(std::ceil(trim_cells));
    for (std::int32_t x = -wide; x <= wide; ++x) {
      for (std::int32_t y = -wide; y <= wide; ++y) {
        for (std::int32_t z = -wide; z <= wide; ++z) {
          for (std::int32_t row = first.get(beside(cell, x, y, z)); row >= 0; row = next[static_cast<std::size_t>(row)]) {
            const double* place = near + 3 * static_cast<std::size_t>(row);
            const double off[3] = {place[0] - at[0], place[1] - at[1], place[2] - at[2]};
            if (off[0] * off[0] + off[1] * off[1] + off[2] * off[2] <= most) return true;
          }
        }
      }
    }
    return false;
  };
  SurfaceNet net;
  std::vector<CellIndex> holds;
  constexpr std::int32_t kSeen = -2;  // looked at, and without a vertex
  for (std::size_t row = 0; row < near_count; ++row) {
    for (std::int32_t x = -1; x <= 1; ++x) {
      for (std::int32_t y = -1; y <= 1; ++y) {
        for (std::int32_t z = -1; z <= 1; ++z) {
          const CellIndex cell = beside(cells[row], x, y, z);
          std::int32_t& number = vertex.at(cell);
          if (number != -1) continue;
          number = kSeen;
          std::array<double, 3> at{};
          if (!detail::crossing(corner, cell, at)) continue;
          for (std::size_t axis = 0; axis < 3; ++axis) at[axis] = (cell[axis] + at[axis]) * cell_m;
          if (!supported(cell, at.data())) continue;
          number = static_cast<std::int32_t>(holds.size());
          holds.push_back(cell);
          net.vertices.insert(net.vertices.end(), at.begin(), at.end());
        }
      }
    }
  }
  for (std::size_t here = 0; here < holds.size(); ++here) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
      CellIndex end = holds[here];
      ++end[axis];
      const bool solid = corner.get(holds[here]).solid();
      const detail::Distance beyond = corner.get(end);
      if (!beyond.known() || solid == beyond.solid()) continue;
      const auto other = [&](std::int32_t back_u, std::int32_t back_v) {
        CellIndex cell = holds[here];
        cell[u] -= back_u;
        cell[v] -= back_v;
        return vertex.get(cell);
      };
      const std::int32_t left = other(1, 0), across = other(1, 1), right = other(0, 1);
      if (left < 0 || across < 0 || right < 0) continue;
      const auto a = static_cast<std::uint32_t>(here), c = static_cast<std::uint32_t>(across);
      const auto b = static_cast<std::uint32_t>(solid ? left : right);
      const auto d = static_cast<std::uint32_t>(solid ? right : left);
      net.triangles.insert(net.triangles.end(), {a, b, c, a, c, d});
    }
  }
  return net;
}

}  // namespace firstfix
