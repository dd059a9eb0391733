// Mean points and times of voxels, as voxel_means and voxel_mean_times give them, in memory that is kept from scan to scan.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/scan/kept_memory.hpp"
#include "firstfix/scan/returns.hpp"
#include "firstfix/scan/voxel_filter.hpp"
#include "firstfix/scan/voxel_order.hpp"

namespace firstfix::detail {

// (count, 3) points in the order of the voxels' z, then y, then x; a time for each, or null.
struct VoxelMeans {
  const double* points = nullptr;
  const double* time_s = nullptr;
  std::size_t count = 0;
};

// Adds points up as they come and sorts the voxels then, which are a tenth of the points. Sums of whole steps are the same in
// any order.
class VoxelSums {
 public:
  // The voxels have a border at kBorderM. What it gives is valid until the next call. Throws as voxel_box does.
  VoxelMeans means(const Returns& returns, double voxel_m) {
    if (returns.count == 0) return {};
    const VoxelBox box = voxel_box(returns.points, returns.count, voxel_m, kBorderM);
    add(returns, voxel_m, box);
    sort(box);
    const std::size_t voxels = order_.size();
    double* const points = points_.of(3 * voxels);
    double* const time_s = returns.time_s == nullptr ? nullptr : time_s_.of(voxels);
    for (std::size_t i = 0; i < voxels; ++i) {
      const Sum& sum = sums_.values()[order_[i].row];
      const double steps = sum.count * kStepsAUnit;
      for (std::size_t axis = 0; axis < 3; ++axis) points[3 * i + axis] = sum.steps[axis] / steps;
      if (time_s != nullptr) time_s[i] = sum.steps[3] / steps;
    }
    return {points, time_s, voxels};
  }

 private:
  struct Sum {
    std::uint64_t voxel;
    double count, steps[4];  // of x, y, z and the time
  };

  static constexpr std::size_t kAtOnce = 256;

  // Numbers the voxels of at most kAtOnce points. A product with the inverse is quicker than a quotient, and has the same whole
  // part where it is not beside a whole number: at most 10^5 voxels from the origin, the two differ by less than 10^-10.
  static void number(const double* metres, std::size_t count, double voxel_m, const VoxelBox& box, std::uint64_t* voxel) {
    constexpr double kBeside = 1e-9;
    const double a_metre = 1 / voxel_m;
    double index[3 * kAtOnce];
    std::size_t beside = 0;
    for (std::size_t i = 0; i < 3 * count; ++i) {
      const double product = (metres[i] - kBorderM) * a_metre;
      index[i] = std::floor(product);
      const double part = product - index[i];
      beside += static_cast<std::size_t>(!((part > kBeside) & (part < 1 - kBeside)));
    }
    if (beside > 0) {
      for (std::size_t i = 0; i < 3 * count; ++i) index[i] = std::floor((metres[i] - kBorderM) / voxel_m);
    }
    const auto along = [&](std::size_t i, std::size_t axis) {
      return static_cast<std::uint64_t>(static_cast<std::int64_t>(index[3 * i + axis] - box.low[axis]));
    };
    for (std::size_t i = 0; i < count; ++i) voxel[i] = (along(i, 2) * box.size[1] + along(i, 1)) * box.size[0] + along(i, 0);
  }

  void add(const Returns& returns, double voxel_m, const VoxelBox& box) {
    unsigned bits = 4;
    while (std::size_t{1} << bits < 2 * returns.count) ++bits;
    const std::size_t last_slot = (std::size_t{1} << bits) - 1;
    std::uint32_t* const slots = slots_.of(last_slot + 1);  // 1 + the row of a voxel's sum; 0: empty
    std::fill_n(slots, last_slot + 1, 0U);
    Sum* const sums = sums_.of(returns.count);
    std::uint32_t found = 0;
    std::uint64_t voxel[kAtOnce];
    double metres[3 * kAtOnce], steps[4][kAtOnce] = {};
    for (std::size_t start = 0; start < returns.count; start += kAtOnce) {
      const std::size_t some = std::min(kAtOnce, returns.count - start);
      const float* p = returns.points + 3 * start;
      for (std::size_t i = 0; i < 3 * some; ++i) metres[i] = static_cast<double>(p[i]);
      for (const std::size_t axis : {0U, 1U, 2U}) {
        for (std::size_t i = 0; i < some; ++i) steps[axis][i] = steps_of(metres[3 * i + axis]);
      }
      number(metres, some, voxel_m, box, voxel);
      if (returns.time_s != nullptr) {
        for (std::size_t i = 0; i < some; ++i) steps[3][i] = steps_of(static_cast<double>(returns.time_s[start + i]));
      }
      for (std::size_t i = 0; i < some; ++i) {
        std::size_t slot = static_cast<std::size_t>(voxel[i] * 0x9E3779B97F4A7C15U >> (64 - bits));
        while (slots[slot] != 0 && sums[slots[slot] - 1].voxel != voxel[i]) slot = (slot + 1) & last_slot;
        if (slots[slot] == 0) {
          sums[found] = {voxel[i], 0, {}};
          slots[slot] = ++found;
        }
        Sum& sum = sums[slots[slot] - 1];
        sum.count += 1;
        for (std::size_t k = 0; k < 4; ++k) sum.steps[k] += steps[k][i];
      }
    }
    order_.resize(found);
  }

  void sort(const VoxelBox& box) {
    const Sum* const sums = sums_.values();
    for (std::size_t row = 0; row < order_.size(); ++row) order_[row] = {sums[row].voxel, static_cast<std::uint32_t>(row)};
    unsigned bits = 0;
    while ((box.count() - 1) >> bits != 0) ++bits;
    sort_by_key(order_, bits);
  }

  KeptMemory<std::uint32_t> slots_;
  KeptMemory<Sum> sums_;
  std::vector<KeyedRow<std::uint64_t>> order_;
  KeptMemory<double> points_, time_s_;
};

}  // namespace firstfix::detail
