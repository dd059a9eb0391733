// A cloud as one plane for each cell: the mean of the cell's points, and the normal of the plane through the points
// around it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/mesh/brick_grid.hpp"
#include "firstfix/bit_exact/eigh3.hpp"

namespace firstfix {

// Rows of cells, in the order in which the points first enter them.
struct CellPlanes {
  std::vector<double> means;    // x, y, z
  std::vector<double> normals;  // unit, of unknown sign
  std::vector<double> weights;  // points in the cell
  std::vector<double> supports;  // points around the cell, nearer ones more: in a plane, those of four cells
  std::vector<double> best;      // the largest support of the 27 cells around
};

namespace detail {

// Sums over points, about a centre that the user of it knows.
struct Moments {
  double count = 0;
  Vector3 sum{};
  Matrix3 product{};

  void add(const Vector3& point) {
    count += 1;
    for (std::size_t i = 0; i < 3; ++i) {
      sum[i] += point[i];
      for (std::size_t j = 0; j < 3; ++j) product[i][j] += point[i] * point[j];
    }
  }

  // Adds weighted moments whose centre stands off this one's.
  void add(const Moments& other, const Vector3& off, double weight) {
    count += weight * other.count;
    for (std::size_t i = 0; i < 3; ++i) {
      sum[i] += weight * (other.sum[i] + other.count * off[i]);
      for (std::size_t j = 0; j < 3; ++j) {
        const double moved = other.sum[i] * off[j] + off[i] * other.sum[j] + other.count * (off[i] * off[j]);
        product[i][j] += weight * (other.product[i][j] + moved);
      }
    }
  }

  Matrix3 covariance() const {
    Matrix3 spread{};
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) spread[i][j] = product[i][j] / count - sum[i] / count * (sum[j] / count);
    }
    return spread;
  }
};

}  // namespace detail

// The points of the 27 cells around count by a tent: 1 in the cell itself, half as much for each axis on which they are
// beside it. Cells with fewer than three points around them have no plane, and are left out. Throws as cell_of does.
inline CellPlanes cell_planes(const double* points, std::size_t count, double cell_m) {
  using detail::Moments;
  BrickGrid<std::int32_t> row_of(-1);
  std::vector<CellIndex> cells;
  std::vector<Moments> own;
  const auto centre = [cell_m](std::int32_t index) { return (index + 0.5) * cell_m; };
  for (std::size_t i = 0; i < count; ++i) {
    const CellIndex cell = cell_of(points + 3 * i, cell_m);
    std::int32_t& row = row_of.at(cell);
    if (row < 0) {
      row = static_cast<std::int32_t>(cells.size());
      cells.push_back(cell);
      own.emplace_back();
    }
    detail::Vector3 from_centre{};
    for (std::size_t axis = 0; axis < 3; ++axis) from_centre[axis] = points[3 * i + axis] - centre(cell[axis]);
    own[static_cast<std::size_t>(row)].add(from_centre);
  }
  CellPlanes planes;
  std::vector<std::size_t> with_plane;
  std::vector<double> support(cells.size());
  for (std::size_t row = 0; row < cells.size(); ++row) {
    Moments around;
    double number = 0;
    for (std::int32_t x = -1; x <= 1; ++x) {
      for (std::int32_t y = -1; y <= 1; ++y) {
        for (std::int32_t z = -1; z <= 1; ++z) {
          const std::int32_t other = row_of.get(beside(cells[row], x, y, z));
          if (other < 0) continue;
          const Moments& there = own[static_cast<std::size_t>(other)];
          const double weight = (x == 0 ? 1.0 : 0.5) * (y == 0 ? 1.0 : 0.5) * (z == 0 ? 1.0 : 0.5);
          around.add(there, {x * cell_m, y * cell_m, z * cell_m}, weight);
          number += there.count;
        }
      }
    }
    support[row] = around.count;
    if (number < 3) continue;
    with_plane.push_back(row);
    const detail::Vector3 normal = detail::smallest_eigenvector(around.covariance()).vector;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      planes.means.push_back(centre(cells[row][axis]) + own[row].sum[axis] / own[row].count);
      planes.normals.push_back(normal[axis]);
    }
    planes.weights.push_back(own[row].count);
    planes.supports.push_back(around.count);
  }
  for (const std::size_t row : with_plane) {
    double best = 0;
    for (std::int32_t x = -1; x <= 1; ++x) {
      for (std::int32_t y = -1; y <= 1; ++y) {
        for (std::int32_t z = -1; z <= 1; ++z) {
          const std::int32_t other = row_of.get(beside(cells[row], x, y, z));
          if (other >= 0) best = std::max(best, support[static_cast<std::size_t>(other)]);
        }
      }
    }
    planes.best.push_back(best);
  }
  return planes;
}

}  // namespace firstfix
