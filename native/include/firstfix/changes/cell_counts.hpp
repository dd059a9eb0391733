// Counts of points and rays in the cells around a sensor.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firstfix {

// A cube of cells around a sensor, and how often each was counted for each of four kinds. Cells that were never counted take
// no room but their place in a table.
class CellCounts {
 public:
  using Counts = std::array<std::int32_t, 4>;

  // turn: (3, 3) from the sensor frame to cells, row by row. start: (3,) of the sensor, in cells. size: cells along an edge.
  CellCounts(const float* turn, const float* start, std::int32_t size)
      : turn_(turn), start_(start), size_(size), place_(static_cast<std::size_t>(size) * size * size) {}

  // Counts a point, x y z, unless it lies outside.
  void add(const float* point, int kind) {
    std::int32_t cell[3];
    for (int axis = 0; axis < 3; ++axis) {
      const float* t = turn_ + 3 * axis;
      const float at = (t[0] * point[0] + t[1] * point[1] + t[2] * point[2]) + start_[axis];
      if (!(at >= 0 && at < static_cast<float>(size_))) return;
      cell[axis] = static_cast<std::int32_t>(at);
    }
    std::int32_t& place = place_[(static_cast<std::size_t>(cell[0]) * size_ + cell[1]) * size_ + cell[2]];
    if (place == 0) {
      counts_.push_back({});
      place = static_cast<std::int32_t>(counts_.size());
    }
    ++counts_[static_cast<std::size_t>(place - 1)][static_cast<std::size_t>(kind)];
  }

  // Counts the ends of the whole steps of a ray, up to its length. direction: x y z, a unit vector.
  void add_ray(const float* direction, float until_m, float step_m, int kind) {
    const float whole = until_m / step_m, most = 2.0F * static_cast<float>(size_);
    const std::int32_t steps = whole > 0 ? static_cast<std::int32_t>(whole < most ? whole : most) : 0;
    for (std::int32_t step = 1; step <= steps; ++step) {
      const float at_m = static_cast<float>(step) * step_m;
      const float point[3] = {direction[0] * at_m, direction[1] * at_m, direction[2] * at_m};
      add(point, kind);
    }
  }

  // Calls use(number, counts) for every cell that was counted, in ascending order of its number in the cube.
  template <class Use>
  void each(Use use) const {
    for (std::size_t number = 0; number < place_.size(); ++number) {
      if (place_[number] != 0) use(static_cast<std::int32_t>(number), counts_[static_cast<std::size_t>(place_[number] - 1)]);
    }
  }

 private:
  const float* turn_;
  const float* start_;
  std::int32_t size_;
  std::vector<std::int32_t> place_;  // of each cell's counts, from 1 on
  std::vector<Counts> counts_;
};

}  // namespace firstfix
