// An endless grid of cubic cells that takes memory only where something is, eight by eight by eight cells at a time.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace firstfix {

using CellIndex = std::array<std::int32_t, 3>;

// The cell of a point: floor(coordinate / cell_m) on each axis. Throws std::invalid_argument for points that are not
// finite, or over kMostCells cells from the origin.
inline CellIndex cell_of(const double* point, double cell_m) {
  constexpr double kMostCells = 1048576.0;
  CellIndex cell{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double index = std::floor(point[axis] / cell_m);
    if (!(std::fabs(index) < kMostCells)) throw std::invalid_argument("a point is not finite, or too many cells away");
    cell[axis] = static_cast<std::int32_t>(index);
  }
  return cell;
}

inline CellIndex beside(const CellIndex& cell, std::int32_t x, std::int32_t y, std::int32_t z) {
  return {cell[0] + x, cell[1] + y, cell[2] + z};
}

template <class T>
class BrickGrid {
 public:
  explicit BrickGrid(T blank) : blank_(blank), slots_(64, Slot{0, kFree}) {}

  // The value of a cell, to be changed.
  T& at(const CellIndex& cell) {
    const std::uint64_t key = key_of(cell);
    if (key != last_key_ || last_ == kFree) {
      last_ = found(key);
      last_key_ = key;
      if (last_ == kFree) last_ = made(key);
    }
    return values_[kInBrick * static_cast<std::size_t>(last_) + place_of(cell)];
  }

  // The value of a cell, blank where nothing was put.
  T get(const CellIndex& cell) const {
    const std::uint64_t key = key_of(cell);
    if (key != last_key_) {
      last_ = found(key);
      last_key_ = key;
    }
    return last_ == kFree ? blank_ : values_[kInBrick * static_cast<std::size_t>(last_) + place_of(cell)];
  }

  // Calls use(brick, values) for every brick, in any order: its first cell's number divided by eight, and its 512 values, x
  // by x, y by y.
  template <class Use>
  void each_brick(Use use) const {
    constexpr std::uint64_t kMask = (1U << 21) - 1;
    for (const Slot& slot : slots_) {
      if (slot.brick == kFree) continue;
      CellIndex brick{};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        brick[axis] = static_cast<std::int32_t>(slot.key >> 21 * (2 - axis) & kMask) - (1 << 20);
      }
      use(brick, values_.data() + kInBrick * static_cast<std::size_t>(slot.brick));
    }
  }

 private:
  static constexpr int kBits = 3;
  static constexpr std::size_t kInBrick = std::size_t{1} << (3 * kBits);
  static constexpr std::uint32_t kFree = 0xFFFFFFFFU;

  struct Slot {
    std::uint64_t key;
    std::uint32_t brick;
  };

  static std::uint64_t key_of(const CellIndex& cell) {
    std::uint64_t key = 0;
    for (const std::int32_t index : cell) key = key << 21 | static_cast<std::uint64_t>((index >> kBits) + (1 << 20));
    return key;
  }

  static std::size_t place_of(const CellIndex& cell) {
    constexpr std::int32_t kMask = (1 << kBits) - 1;
    return static_cast<std::size_t>(((cell[0] & kMask) << kBits | (cell[1] & kMask)) << kBits | (cell[2] & kMask));
  }

  std::size_t slot_of(std::uint64_t key) const {
    std::uint64_t mixed = (key ^ key >> 31) * 0x9E3779B97F4A7C15ULL;
    mixed ^= mixed >> 29;
    std::size_t slot = static_cast<std::size_t>(mixed) & (slots_.size() - 1);
    while (slots_[slot].brick != kFree && slots_[slot].key != key) slot = (slot + 1) & (slots_.size() - 1);
    return slot;
  }

  std::uint32_t found(std::uint64_t key) const { return slots_[slot_of(key)].brick; }

  std::uint32_t made(std::uint64_t key) {
    if (2 * (bricks_ + 1) > slots_.size()) {
      std::vector<Slot> before(2 * slots_.size(), Slot{0, kFree});
      before.swap(slots_);
      for (const Slot& slot : before) {
        if (slot.brick != kFree) slots_[slot_of(slot.key)] = slot;
      }
    }
    values_.resize(values_.size() + kInBrick, blank_);
    slots_[slot_of(key)] = {key, bricks_};
    return bricks_++;
  }

  T blank_;
  std::vector<Slot> slots_;
  std::vector<T> values_;
  std::uint32_t bricks_ = 0;
  mutable std::uint64_t last_key_ = ~std::uint64_t{0};
  mutable std::uint32_t last_ = kFree;
};

}  // namespace firstfix
