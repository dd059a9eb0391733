// The cells that a ray passes, brick by brick: a brick that is of no interest takes no time for its cells.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>

#include "firstfix/mesh/brick_grid.hpp"

namespace firstfix {

// One bit for each cell of a brick: eight layers along x, of 64 cells y * 8 + z each.
using BrickBits = std::array<std::uint64_t, 8>;

// Every cell between two points, border by border (Amanatides and Woo, 1987).
//
// The time of a border is its place along the ray, of which the whole is kEnd. Times are whole numbers, so their sums are
// exact: a walk that leaves out the cells of a brick goes on in the same cell as one that does not.
class BrickWalk {
 public:
  // Throws std::invalid_argument for points that are not finite, or too far from the origin or from each other.
  BrickWalk(const double* from, const double* to, double cell_m) {
    const CellIndex cell = cell_of(from, cell_m), last = cell_of(to, cell_m);
    constexpr std::int32_t kApart[3] = {64, 8, 1};  // of neighbours in a brick
    for (std::size_t i = 0; i < 3; ++i) {
      const double at = from[i] / cell_m, along = to[i] / cell_m - at;
      const std::int32_t cells = last[i] - cell[i], within = cell[i] & 7;
      if (cells > kMostCells || cells < -kMostCells) throw std::invalid_argument("a ray passes too many cells");
      const bool is_up = cells > 0;
      std::int64_t first = kNever / 2, apart = kNever;
      if (cells != 0) {
        const double exact = std::min(static_cast<double>(kEnd) / std::fabs(along), static_cast<double>(kNever));
        const double to_border = is_up ? cell[i] + 1 - at : at - cell[i];
        apart = whole(exact);
        first = std::min({whole(to_border * exact), apart - kRanks, kNever / 2});
      }
      brick_[i] = cell[i] >> 3;
      Axis& axis = axes_[i];
      axis.step = is_up ? 1 : -1;
      axis.apart = apart;
      axis.per_apart = 1 / static_cast<double>(apart);
      axis.cell = is_up ? kApart[i] : -kApart[i];
      behind_ += is_up ? 8 * kApart[i] : -kApart[i];
      // The last bits are the axis: no two borders have the same time.
      axis.leaves = first + (3 - static_cast<std::int64_t>(i)) + (is_up ? 7 - within : within) * apart;
    }
    find_end_of_brick();
  }

  const CellIndex& brick() const { return brick_; }

  // Sets the bits of the cells that the ray passes in this brick.
  void mark(BrickBits& bits) const {
    std::int64_t next[3];
    std::int32_t at = behind_;
    for (std::size_t i = 0; i < 3; ++i) {
      const Axis& axis = axes_[i];
      const std::int64_t left = axis.leaves - entered_ - 1;
      auto borders = static_cast<std::int64_t>(static_cast<double>(left) * axis.per_apart);  // or one too many, or too few
      const std::int64_t rest = left - borders * axis.apart;
      borders += (rest >= axis.apart) - (rest < 0);
      next[i] = axis.leaves - borders * axis.apart;
      at -= static_cast<std::int32_t>(borders + 1) * axis.cell;
    }
    std::int64_t x = next[0], y = next[1], z = next[2];
    const Axis along_x = axes_[0], along_y = axes_[1], along_z = axes_[2];  // in registers: `bits` might be part of this
    for (const std::int64_t end = left_;;) {
      bits[static_cast<std::size_t>(at) >> 6] |= std::uint64_t{1} << (at & 63);
      const std::int64_t time = std::min(std::min(x, y), z);
      if (time >= end) return;
      const std::int64_t is_x = -std::int64_t{x == time}, is_y = -std::int64_t{y == time}, is_z = -std::int64_t{z == time};
      x += along_x.apart & is_x;  // no branch: which border is next cannot be foreseen
      y += along_y.apart & is_y;
      z += along_z.apart & is_z;
      at += (along_x.cell & static_cast<std::int32_t>(is_x)) + (along_y.cell & static_cast<std::int32_t>(is_y)) +
            (along_z.cell & static_cast<std::int32_t>(is_z));
    }
  }

  // Goes on to the next brick. Returns whether there is one.
  bool next() {
    if (left_ == kEnd) return false;
    const std::size_t i = axes_[0].leaves == left_ ? 0 : axes_[1].leaves == left_ ? 1 : 2;
    brick_[i] += axes_[i].step;
    axes_[i].leaves += 8 * axes_[i].apart;
    entered_ = left_;
    find_end_of_brick();
    return true;
  }

 private:
  static constexpr std::int64_t kEnd = std::int64_t{1} << 50, kNever = std::int64_t{1} << 58;
  static constexpr std::int64_t kRanks = 4;             // of times that are otherwise the same
  static constexpr std::int32_t kMostCells = 1 << 14;  // of a ray along an axis

  struct Axis {
    std::int64_t apart;   // from border to border of cells
    std::int64_t leaves;  // time of the next border of bricks
    double per_apart;
    std::int32_t step;    // to the next brick
    std::int32_t cell;    // from a cell to the next one, in a brick
  };

  static std::int64_t whole(double time) { return static_cast<std::int64_t>(time) & ~(kRanks - 1); }

  void find_end_of_brick() {
    left_ = std::min(std::min(axes_[0].leaves, axes_[1].leaves), std::min(axes_[2].leaves, kEnd));
  }

  CellIndex brick_{};
  Axis axes_[3];
  std::int64_t entered_ = 0, left_ = 0;  // of this brick
  std::int32_t behind_ = 0;  // place of the cell behind the brick's furthest one, on each axis
};

}  // namespace firstfix
