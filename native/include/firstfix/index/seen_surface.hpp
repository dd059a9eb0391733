// Where returns lie on a surface: the mean point of every voxel, and the mean direction to those who see it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace firstfix {

// Returns are added scan by scan. Memory grows with the surface, not with the returns.
class SeenSurface {
 public:
  static constexpr std::size_t kColumns = 7;  // of a voxel: mean x, y, z, mean direction to the viewers, returns

  explicit SeenSurface(double voxel_m) : voxel_m_(voxel_m), voxels_(std::size_t{1} << kLeastBits) {}

  // Origins (number, 3), unit directions (count, 3), ranges (number, count), infinite where there is no return.
  // Throws std::invalid_argument for a return more than 2^20 voxels away from the frame's origin.
  void add(const float* origins, std::size_t number, const float* directions, std::size_t count, const float* ranges) {
    for (std::size_t scan = 0; scan < number; ++scan) {
      for (std::size_t start = 0; start < count; start += kBlock) {
        const std::size_t end = std::min(start + kBlock, count);
        add_block(origins + 3 * scan, directions, ranges + scan * count, start, end);
      }
    }
  }

  // (voxels, kColumns), in the order of the voxels' x, then y, then z.
  std::vector<double> means() const {
    std::vector<const Voxel*> kept;
    kept.reserve(filled_);
    for (const Voxel& voxel : voxels_) {
      if (voxel.count) kept.push_back(&voxel);
    }
    std::sort(kept.begin(), kept.end(), [](const Voxel* a, const Voxel* b) { return a->key < b->key; });
    std::vector<double> columns;
    columns.reserve(kColumns * kept.size());
    for (const Voxel* voxel : kept) {
      for (const double sum : voxel->point) columns.push_back(sum / voxel->count);
      for (const float sum : voxel->toward) columns.push_back(static_cast<double>(sum) / voxel->count);
      columns.push_back(voxel->count);
    }
    return columns;
  }

 private:
  struct Voxel {
    std::uint64_t key;  // x, y, z of 21 bits
    double point[3];
    float toward[3];
    std::uint32_t count;  // 0: the place is empty
  };

  static constexpr unsigned kLeastBits = 16;
  static constexpr std::size_t kBlock = 64;
  static constexpr double kReach = 1 << 20;  // voxels to either side

  void add_block(const float* origin, const float* directions, const float* ranges, std::size_t start,
                 std::size_t end) {
    double points[kBlock][3];
    std::uint64_t keys[kBlock];
    const float* toward[kBlock];
    std::size_t seen = 0;
    if (10 * (filled_ + kBlock) > 6 * voxels_.size()) grow();
    for (std::size_t ray = start; ray < end; ++ray) {
      if (!std::isfinite(ranges[ray])) continue;
      std::uint64_t key = 0;
      for (int a = 0; a < 3; ++a) {
        points[seen][a] = static_cast<double>(origin[a]) + static_cast<double>(directions[3 * ray + a] * ranges[ray]);
        const double cell = std::floor(points[seen][a] / voxel_m_);
        if (!(std::fabs(cell) < kReach)) throw std::invalid_argument("a return is too far from the frame's origin");
        key = key << 21 | static_cast<std::uint64_t>(cell + kReach);
      }
      keys[seen] = key;
      toward[seen] = directions + 3 * ray;
      __builtin_prefetch(&voxels_[place_of(key)], 1);
      ++seen;
    }
    for (std::size_t i = 0; i < seen; ++i) {
      Voxel& voxel = voxel_of(keys[i]);
      filled_ += voxel.count == 0;
      voxel.key = keys[i];
      ++voxel.count;
      for (int a = 0; a < 3; ++a) {
        voxel.point[a] += points[i][a];
        voxel.toward[a] -= toward[i][a];
      }
    }
  }

  std::size_t place_of(std::uint64_t key) const {
    const std::uint64_t mixed = (key ^ key >> 29) * 0x9E3779B97F4A7C15U;
    return static_cast<std::size_t>(mixed >> 20) & (voxels_.size() - 1);
  }

  // The voxel of a key, or the empty place for it.
  Voxel& voxel_of(std::uint64_t key) {
    std::size_t place = place_of(key);
    while (voxels_[place].count && voxels_[place].key != key) place = (place + 1) & (voxels_.size() - 1);
    return voxels_[place];
  }

  void grow() {
    std::vector<Voxel> before(2 * voxels_.size());
    before.swap(voxels_);
    for (const Voxel& voxel : before) {
      if (voxel.count) voxel_of(voxel.key) = voxel;
    }
  }

  double voxel_m_;
  std::vector<Voxel> voxels_;
  std::size_t filled_ = 0;
};

}  // namespace firstfix
