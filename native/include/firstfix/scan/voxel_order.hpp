// Points sorted by the voxel that they are in. A voxel's index on an axis is floor((coordinate - border_m) / voxel_m), in
// double: border_m is the coordinate of a border between voxels.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <type_traits>
#include <vector>

namespace firstfix::detail {

// Which axis is the slowest index of a voxel, which the next and which the fastest.
using AxisOrder = std::array<std::size_t, 3>;
constexpr AxisOrder kZYX{2, 1, 0}, kXYZ{0, 1, 2};

// The voxels that a cloud's box covers.
struct VoxelBox {
  double low[3];          // index of the first voxel on each axis
  std::uint64_t size[3];  // voxels on each axis

  std::uint64_t count() const { return size[0] * size[1] * size[2]; }
};

// Throws std::invalid_argument for points that are not finite, or too far apart to be numbered.
template <class T>
VoxelBox voxel_box(const T* points, std::size_t count, double voxel_m, double border_m) {
  constexpr std::size_t kInStep = 24;  // eight points: a vector register of each axis in turn
  T least[kInStep], most[kInStep], not_finite[kInStep] = {};
  std::fill_n(least, kInStep, std::numeric_limits<T>::infinity());
  std::fill_n(most, kInStep, -std::numeric_limits<T>::infinity());
  const auto take = [&](const T* from, std::size_t lanes) {
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      least[lane] = from[lane] < least[lane] ? from[lane] : least[lane];
      most[lane] = from[lane] > most[lane] ? from[lane] : most[lane];
      not_finite[lane] += from[lane] - from[lane];
    }
  };
  const std::size_t numbers = 3 * count, whole = numbers - numbers % kInStep;
  for (std::size_t i = 0; i < whole; i += kInStep) take(points + i, kInStep);
  take(points + whole, numbers - whole);
  VoxelBox box{};
  constexpr double kMostVoxels = 4503599627370496.0;  // 2^52 on an axis: a difference of indices is exact
  bool usable = voxel_m > 0 && count <= std::numeric_limits<std::uint32_t>::max();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (std::size_t lane = axis + 3; lane < kInStep; lane += 3) {
      least[axis] = std::min(least[axis], least[lane]);
      most[axis] = std::max(most[axis], most[lane]);
      not_finite[axis] += not_finite[lane];
    }
    box.low[axis] = std::floor((static_cast<double>(least[axis]) - border_m) / voxel_m);
    const double size = std::floor((static_cast<double>(most[axis]) - border_m) / voxel_m) - box.low[axis] + 1;
    usable = usable && not_finite[axis] == 0 && size >= 1 && size <= kMostVoxels;
    box.size[axis] = usable ? static_cast<std::uint64_t>(size) : 1;
  }
  double voxels = 1;
  for (const std::uint64_t size : box.size) voxels *= static_cast<double>(size);
  if (!usable || voxels > 4611686018427387904.0) {  // 2^62
    throw std::invalid_argument("points are not finite, or too far apart for voxels of this size");
  }
  return box;
}

template <class Key>
struct KeyedRow {
  Key key;
  std::uint32_t row;
};

// Radix sort by the lowest bits of the key. Rows with one key keep their order.
template <class Key>
void sort_by_key(std::vector<KeyedRow<Key>>& entries, unsigned bits) {
  constexpr unsigned kMostDigitBits = 11;  // a table of 8 KB
  const unsigned digits = (bits + kMostDigitBits - 1) / kMostDigitBits;
  if (digits == 0) return;
  const unsigned digit_bits = (bits + digits - 1) / digits;
  const Key mask = (Key{1} << digit_bits) - 1;
  std::vector<KeyedRow<Key>> sorted(entries.size());
  std::vector<std::uint32_t> next(std::size_t{1} << digit_bits);
  for (unsigned shift = 0; shift < bits; shift += digit_bits) {
    std::fill(next.begin(), next.end(), 0);
    for (const auto& entry : entries) ++next[static_cast<std::size_t>(entry.key >> shift & mask)];
    std::uint32_t before = 0;
    for (std::uint32_t& start : next) {
      const std::uint32_t here = start;
      start = before;
      before += here;
    }
    for (const auto& entry : entries) sorted[next[static_cast<std::size_t>(entry.key >> shift & mask)]++] = entry;
    entries.swap(sorted);
  }
}

template <class Key, class T>
std::vector<KeyedRow<Key>> rows_by_voxel(const T* points, std::size_t count, double voxel_m, double border_m,
                                         const VoxelBox& box, const AxisOrder& order) {
  constexpr std::size_t kBlock = 256;
  std::vector<KeyedRow<Key>> entries(count);
  using Index = std::make_signed_t<Key>;
  Index cell[3][kBlock];
  for (std::size_t start = 0; start < count; start += kBlock) {
    const std::size_t block = std::min(kBlock, count - start);
    const T* from = points + 3 * start;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double low = box.low[axis];
      for (std::size_t i = 0; i < block; ++i) {
        cell[axis][i] = static_cast<Index>(std::floor((static_cast<double>(from[3 * i + axis]) - border_m) / voxel_m) - low);
      }
    }
    const Index *slow = cell[order[0]], *middle = cell[order[1]], *fast = cell[order[2]];
    const auto width = static_cast<Key>(box.size[order[2]]), depth = static_cast<Key>(box.size[order[1]]);
    for (std::size_t i = 0; i < block; ++i) {
      const Key row = static_cast<Key>(slow[i]) * depth + static_cast<Key>(middle[i]);
      entries[start + i] = {row * width + static_cast<Key>(fast[i]), static_cast<std::uint32_t>(start + i)};
    }
  }
  unsigned bits = 0;
  while ((box.count() - 1) >> bits != 0) ++bits;
  sort_by_key(entries, bits);
  return entries;
}

// Calls use(Key{}) with the smallest type of keys that number all voxels of a box.
template <class Use>
auto with_key(const VoxelBox& box, Use use) {
  return box.count() <= std::uint64_t{1} << 31 ? use(std::uint32_t{}) : use(std::uint64_t{});
}

// Calls visit(first, last) for the entries of every occupied voxel: their `row` is ascending.
template <class T, class Visit>
void each_voxel(const T* points, std::size_t count, double voxel_m, double border_m, const AxisOrder& order,
                Visit visit) {
  if (count == 0) return;
  const VoxelBox box = voxel_box(points, count, voxel_m, border_m);
  with_key(box, [&](auto key) {
    const auto entries = rows_by_voxel<decltype(key)>(points, count, voxel_m, border_m, box, order);
    const auto* const end = entries.data() + count;
    for (const auto* first = entries.data(); first != end;) {
      const auto* last = first;
      while (last != end && last->key == first->key) ++last;
      visit(first, last);
      first = last;
    }
  });
}

// Means of kNumbers numbers over the points of every voxel, (voxels, kNumbers): ordered by the voxels' z, then y, then x.
// add(row, sums): adds those of a point, as whole numbers of steps. Points are counted and added in one run.
template <std::size_t kNumbers, class T, class Add>
std::vector<double> means_by_voxel(const T* points, std::size_t count, double voxel_m, double border_m, double steps_a_unit,
                                   Add add) {
  std::vector<double> means;
  if (count == 0) return means;
  const VoxelBox box = voxel_box(points, count, voxel_m, border_m);
  with_key(box, [&](auto key) {
    const auto entries = rows_by_voxel<decltype(key)>(points, count, voxel_m, border_m, box, kZYX);
    std::size_t voxels = 1;
    for (std::size_t i = 1; i < count; ++i) voxels += static_cast<std::size_t>(entries[i].key != entries[i - 1].key);
    means.resize(kNumbers * voxels);
    double* mean = means.data();
    const auto* const end = entries.data() + count;
    for (const auto* first = entries.data(); first != end;) {
      double sums[kNumbers] = {};
      const auto* last = first;
      for (; last != end && last->key == first->key; ++last) add(std::size_t{last->row}, sums);
      const double steps = static_cast<double>(last - first) * steps_a_unit;
      for (const double sum : sums) *mean++ = sum / steps;
      first = last;
    }
  });
  return means;
}

}  // namespace firstfix::detail
