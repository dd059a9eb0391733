// The descriptor's occupied cells of simulated scans, without the scans: equal to cast_rays, then occupied_cells, to the
// last bit. A ray is followed no further than a return could fill a cell. What looks down ends above the floor.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/simulation/cast_rays.hpp"
#include "firstfix/simulation/ray_bundles.hpp"
#include "firstfix/simulation/triangle_tree.hpp"

namespace firstfix {
namespace detail {

constexpr float kPastCells = 1 + 1e-5F, kPastCellsM = 1e-3F;  // more than a return's place is rounded

// Ranges beyond which no return of a ray lies in a cell of the grid.
class RangesOfCells {
 public:
  RangesOfCells(Vectors<const float> directions, const LayeredGrid& grid, float max_range_m)
      : lowest_(grid.edges_m.front()), highest_(grid.edges_m.back()), level_m_(directions.size),
        of_a_metre_(directions.size), rises_(directions.size) {
    for (std::size_t i = 0; i < directions.size; ++i) {
      const float* d = directions[i];
      const float level = std::sqrt(d[0] * d[0] + d[1] * d[1]);
      level_m_[i] = std::min(max_range_m, level > 1e-6F ? grid.end_m / level * kPastCells + kPastCellsM : max_range_m);
      of_a_metre_[i] = 1 / std::max(std::fabs(d[2]), 1e-6F) * kPastCells;
      rises_[i] = d[2] > 0;
    }
  }

  float of(std::uint32_t ray, float height_m) const {
    const float way_m = rises_[ray] ? highest_ - height_m : height_m - lowest_;
    return std::min(level_m_[ray], (std::max(way_m, 0.0F) + kPastCellsM) * of_a_metre_[ray]);
  }

 private:
  float lowest_, highest_;
  std::vector<float> level_m_, of_a_metre_;
  std::vector<std::uint8_t> rises_;
};

// Sets filled[cell] of the returns of unit directions, whose ranges are infinite where there is none.
inline void fill_returns(Vectors<const float> directions, const float* ranges, float height_m,
                         const LayeredGrid& grid, std::uint8_t* filled) {
  float points[3 * kPointsAtOnce];
  std::size_t kept = 0;
  const auto flush = [&] {
    fill_cells<false>(points, kept, {}, height_m, grid, filled);
    kept = 0;
  };
  for (std::size_t ray = 0; ray < directions.size; ++ray) {
    if (!std::isfinite(ranges[ray])) continue;
    for (int a = 0; a < 3; ++a) points[3 * kept + static_cast<std::size_t>(a)] = directions[ray][a] * ranges[ray];
    if (++kept == kPointsAtOnce) flush();
  }
  flush();
}

}  // namespace detail

// Bits (origins, grid.bytes()) of level sensors at origins, each at its height_m above its floor, that look into unit
// directions. `order` and the limits of ranges are those of `cast_rays`.
inline void cast_cells(const TriangleTree& tree, Vectors<const float> origins, const float* height_m,
                       Vectors<const float> directions, const std::uint32_t* order, float min_range_m, float max_range_m,
                       const LayeredGrid& grid, std::uint8_t* bits) {
  const std::size_t count = directions.size;
  const float beyond = std::nextafter(max_range_m, std::numeric_limits<float>::infinity());
  const detail::RangesOfCells limits(directions, grid, beyond);
  std::vector<float> ranges(detail::kOrigins * count);
  std::vector<std::uint8_t> filled(grid.cells() + 1);
  for (std::size_t first = 0; first < origins.size; first += detail::kOrigins) {
    const std::size_t end = std::min(first + detail::kOrigins, origins.size);
    for (std::size_t start = 0; start < count; start += kBundle) {
      const std::size_t rays = std::min(kBundle, count - start);
      const Span<const std::uint32_t> rows{order + start, rays};
      const detail::Bundle made = detail::bundle_of(directions, rows, beyond);
      for (std::size_t at = first; at < end; ++at) {
        detail::Bundle bundle = made;
        for (std::size_t i = 0; i < kBundle; ++i) {
          bundle.range.set(static_cast<int>(i), limits.of(rows[std::min(i, rays - 1)], height_m[at]));
        }
        const detail::F16 limit = bundle.range;
        detail::cast_bundle(tree, origins[at], bundle);
        for (std::size_t i = 0; i < rays; ++i) {
          const float range = bundle.range[static_cast<int>(i)];
          const bool met = range < limit[static_cast<int>(i)] && range >= min_range_m;
          ranges[(at - first) * count + rows[i]] = met ? range : std::numeric_limits<float>::infinity();
        }
      }
    }
    for (std::size_t at = first; at < end; ++at) {
      std::fill(filled.begin(), filled.end(), std::uint8_t{0});
      detail::fill_returns(directions, ranges.data() + (at - first) * count, height_m[at], grid, filled.data());
      detail::pack_bits(filled.data(), grid.cells(), bits + at * grid.bytes());
    }
  }
}

}  // namespace firstfix
