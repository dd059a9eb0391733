// Thins a table of points to the mean row of every voxel.
#pragma once

#include <cstddef>
#include <vector>

#include "firstfix/scan/voxel_order.hpp"

namespace firstfix {

// Rows of `columns` numbers, the first three x, y, z in metres. In the order of the voxels' x, then y, then z. Throws as
// voxel_box does.
inline std::vector<double> column_means(const double* rows, std::size_t count, std::size_t columns, double voxel_m) {
  std::vector<double> points(3 * count), means;
  for (std::size_t row = 0; row < count; ++row) {
    for (std::size_t axis = 0; axis < 3; ++axis) points[3 * row + axis] = rows[columns * row + axis];
  }
  detail::each_voxel(points.data(), count, voxel_m, 0.0, detail::kXYZ, [&](const auto* first, const auto* last) {
    const std::size_t start = means.size();
    means.resize(start + columns);
    for (const auto* entry = first; entry != last; ++entry) {
      for (std::size_t i = 0; i < columns; ++i) means[start + i] += rows[columns * entry->row + i];
    }
    for (std::size_t i = 0; i < columns; ++i) means[start + i] /= static_cast<double>(last - first);
  });
  return means;
}

}  // namespace firstfix
