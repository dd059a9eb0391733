// Encoding of a compact query: from points and ranges to the bytes that are compressed then.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "firstfix/scan/cell_box.hpp"
#include "firstfix/scan/voxel_order.hpp"
#include "firstfix/wire/bytes.hpp"
#include "firstfix/wire/planes.hpp"

namespace firstfix {

// The points of a compact query as cells of 16 steps, and places in them.
struct CompactPlanes {
  detail::CellBox box;
  std::vector<std::int64_t> order;  // the rows of the points, by their cells
  Bytes planes;             // of the cells' differences, 4 bytes for each point
  Bytes low;                // 12 bits for each point: its place in its cell
};

// Encodes (count, 3) coordinates of at most 1000 m; a step is 4 mm at least: no number overflows.
inline CompactPlanes compact_planes(const float* points, std::size_t count, double resolution_m) {
  std::vector<detail::Cell> steps(count), cells(count);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double q = std::nearbyint(static_cast<double>(points[3 * i + axis]) / resolution_m);
      steps[i][axis] = static_cast<std::int64_t>(q);
      cells[i][axis] = static_cast<std::int64_t>(std::floor(q / 16.0));
    }
  }
  CompactPlanes made{detail::CellBox::around(cells), {}, {}, {}};
  std::vector<detail::KeyedRow<std::uint64_t>> by_cell(count);  // equal cells keep their order
  std::uint64_t any = 0;  // the bits of all numbers
  for (std::size_t i = 0; i < count; ++i) {
    by_cell[i] = {static_cast<std::uint64_t>(made.box.number(cells[i])), static_cast<std::uint32_t>(i)};
    any |= by_cell[i].key;
  }
  unsigned bits = 0;
  while (any >> bits != 0) ++bits;
  detail::sort_by_key(by_cell, bits);
  std::vector<std::uint32_t> apart(count);
  made.order.resize(count);
  made.low.resize(3 * ((count + 1) / 2));
  std::uint64_t before = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint64_t number = by_cell[k].key;
    const std::size_t row = by_cell[k].row;
    made.order[k] = static_cast<std::int64_t>(row);
    apart[k] = static_cast<std::uint32_t>(number - before);
    before = number;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto place = static_cast<unsigned>(steps[row][axis] - 16 * cells[row][axis]);
      const std::size_t half = 3 * k + axis;
      made.low[half / 2] = static_cast<std::uint8_t>(made.low[half / 2] | place << (half % 2 == 0 ? 4U : 0U));
    }
  }
  detail::put_planes(made.planes, apart, 4);
  return made;
}

// A bit for each direction that has a return, then for each return the difference of its level from the one before.
// `edges_m` has the ranges, ascending, at which the levels from 1 on end; infinite is a direction without a return.
inline Bytes levels_of_ranges(const float* nearest_m, std::size_t directions, const float* edges_m,
                                      std::size_t edges) {
  Bytes content((directions + 7) / 8);
  content.reserve(content.size() + directions);
  std::uint8_t before = 0;
  std::size_t level = 0;  // that of the direction before, mostly near this one's
  for (std::size_t i = 0; i < directions; ++i) {
    const float range_m = nearest_m[i];
    if (!(range_m < std::numeric_limits<float>::infinity())) continue;
    content[i / 8] = static_cast<std::uint8_t>(content[i / 8] | (0x80U >> (i % 8)));
    while (level < edges && range_m >= edges_m[level]) ++level;
    while (level > 0 && range_m < edges_m[level - 1]) --level;
    const auto own = static_cast<std::uint8_t>(level + 1);
    content.push_back(static_cast<std::uint8_t>(own - before));
    before = own;
  }
  return content;
}

}  // namespace firstfix
