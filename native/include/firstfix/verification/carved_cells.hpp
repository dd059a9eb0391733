// Cells that a mapping run saw free: its rays passed through them (docs/method.md section 6).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

#include "firstfix/mesh/brick_grid.hpp"
#include "firstfix/verification/brick_walk.hpp"

namespace firstfix {

// Bricks in the order of their numbers, x then y then z.
struct CarvedBricks {
  std::vector<std::int32_t> brick;  // (n, 3): the first cell's number, divided by eight
  std::vector<BrickBits> once, twice;
};

// Rays are added pose by pose. A cell counts the poses that passed it: none, one, or more.
class CarvedCells {
 public:
  explicit CarvedCells(double cell_m) : cell_m_(cell_m), rows_(kNone) {}

  // directions: (count, 3) unit vectors. ranges: (count), without a return not finite. The last back_off_m of a ray are
  // left out. Throws std::invalid_argument for a ray that is too long, or too far from the frame's origin.
  void add(const double* origin, const float* directions, std::size_t count, const float* ranges, double back_off_m) {
    count_pose();
    for (std::size_t ray = 0; ray < count; ++ray) {
      const double length = static_cast<double>(ranges[ray]) - back_off_m;
      if (!std::isfinite(length) || !(length > 0)) continue;
      double end[3];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        end[axis] = origin[axis] + static_cast<double>(directions[3 * ray + axis]) * length;
      }
      BrickWalk walk(origin, end, cell_m_);
      do {
        if (BrickBits* passed = passed_in(walk.brick())) walk.mark(*passed);
      } while (walk.next());
    }
  }

  CarvedBricks bricks() {
    count_pose();
    std::vector<std::uint32_t> order(bricks_.size());
    std::iota(order.begin(), order.end(), 0U);
    std::sort(order.begin(), order.end(), [&](auto a, auto b) { return bricks_[a].number < bricks_[b].number; });
    CarvedBricks all;
    for (const std::uint32_t row : order) {
      const Brick& brick = bricks_[row];
      all.brick.insert(all.brick.end(), brick.number.begin(), brick.number.end());
      all.once.push_back(brick.once);
      all.twice.push_back(brick.twice);
    }
    return all;
  }

 private:
  static constexpr std::uint32_t kNone = 0xFFFFFFFFU, kFull = kNone - 1;

  struct Brick {
    CellIndex number;
    bool is_passed;             // by this pose
    BrickBits passed;           // by this pose
    BrickBits once{}, twice{};  // by so many poses before it, or more
  };

  // Where this pose marks the cells of a brick; null: all of them have been passed twice, and nothing can change.
  BrickBits* passed_in(const CellIndex& number) {
    std::uint32_t& row = rows_.at(number);
    if (row == kFull) return nullptr;
    if (row == kNone) {
      row = static_cast<std::uint32_t>(bricks_.size());
      bricks_.push_back({number, false, {}});
    }
    Brick& brick = bricks_[row];
    if (!brick.is_passed) {
      brick.is_passed = true;
      passed_.push_back(row);
    }
    return &brick.passed;
  }

  // Counts the cells that the pose passed whose rays were added last.
  void count_pose() {
    for (const std::uint32_t row : passed_) {
      Brick& brick = bricks_[row];
      std::uint64_t in_all = ~std::uint64_t{0};
      for (std::size_t x = 0; x < 8; ++x) {
        brick.twice[x] |= brick.once[x] & brick.passed[x];
        brick.once[x] |= brick.passed[x];
        in_all &= brick.twice[x];
      }
      brick.is_passed = false;
      brick.passed = {};
      if (in_all == ~std::uint64_t{0}) rows_.at(brick.number) = kFull;
    }
    passed_.clear();
  }

  double cell_m_;
  BrickGrid<std::uint32_t> rows_;  // of `bricks_`, by the bricks' numbers; or kNone, or kFull
  std::vector<Brick> bricks_;
  std::vector<std::uint32_t> passed_;  // rows of the bricks that this pose passed
};

// Takes the cells that hold one of (count, 3) points, and the 26 around each, out of `bits` (of (n, 3) bricks, each of
// which stands once). Throws std::invalid_argument for points that are not finite, or too far from the origin.
inline void take_out_near(const std::int32_t* brick, std::size_t n, const double* points, std::size_t count, double cell_m,
                          BrickBits* bits) {
  BrickGrid<std::uint8_t> occupied(0);  // eight cells along z at once, a bit each
  for (std::size_t i = 0; i < count; ++i) {
    const CellIndex cell = cell_of(points + 3 * i, cell_m);
    occupied.at({cell[0], cell[1], cell[2] >> 3}) |= static_cast<std::uint8_t>(1U << (cell[2] & 7));
  }
  for (std::size_t row = 0; row < n; ++row) {
    const CellIndex first{8 * brick[3 * row], 8 * brick[3 * row + 1], brick[3 * row + 2]};
    std::uint32_t near[10][10];  // bit z: the cell there, or one above or below it
    std::uint32_t any = 0;
    for (std::int32_t x = 0; x < 10; ++x) {
      for (std::int32_t y = 0; y < 10; ++y) {
        const auto along_z = [&](std::int32_t step) {
          return static_cast<std::uint32_t>(occupied.get(beside(first, x - 1, y - 1, step)));
        };
        const std::uint32_t cells = along_z(-1) >> 7 | along_z(0) << 1 | (along_z(1) & 1U) << 9;
        any |= near[x][y] = (cells | cells >> 1 | cells >> 2) & 0xFFU;
      }
    }
    if (!any) continue;
    for (std::size_t x = 0; x < 8; ++x) {
      std::uint64_t taken = 0;
      for (std::size_t y = 0; y < 8; ++y) {
        std::uint32_t around = 0;
        for (std::size_t i = 0; i < 9; ++i) around |= near[x + i / 3][y + i % 3];
        taken |= static_cast<std::uint64_t>(around) << (8 * y);
      }
      bits[row][x] &= ~taken;
    }
  }
}

}  // namespace firstfix
