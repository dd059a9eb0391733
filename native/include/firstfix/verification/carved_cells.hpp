// Cells that a mapping run saw free: its rays passed through them (docs/method.md section 6).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <utility>
#include <vector>

#include "firstfix/mesh/brick_grid.hpp"

namespace firstfix {

// One bit for each cell of a brick: eight layers along x, of 64 cells y * 8 + z each.
using BrickBits = std::array<std::uint64_t, 8>;

// Bricks in the order of their numbers, x then y then z.
struct CarvedBricks {
  std::vector<std::int32_t> brick;  // (n, 3): the first cell's number, divided by eight
  std::vector<BrickBits> once, twice;
};

// Rays are added pose by pose. A cell counts the poses that passed it: none, one, or more.
class CarvedCells {
 public:
  explicit CarvedCells(double cell_m) : cell_m_(cell_m), grid_(0) {}

  // directions: (count, 3) unit vectors. ranges: (count), without a return not finite. The last back_off_m of a ray are
  // left out. Throws std::invalid_argument for a ray that is too long, or too far from the frame's origin.
  void add(const double* origin, const float* directions, std::size_t count, const float* ranges, double back_off_m) {
    if (++pose_ > kMostPoses) throw std::invalid_argument("there are too many poses");
    for (std::size_t ray = 0; ray < count; ++ray) {
      const double length = static_cast<double>(ranges[ray]) - back_off_m;
      if (!std::isfinite(length) || !(length > 0)) continue;
      double end[3];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        end[axis] = origin[axis] + static_cast<double>(directions[3 * ray + axis]) * length;
      }
      walk(origin, end);
    }
  }

  CarvedBricks bricks() const {
    std::vector<std::pair<CellIndex, const std::uint32_t*>> found;
    grid_.each_brick([&](const CellIndex& brick, const std::uint32_t* cells) { found.emplace_back(brick, cells); });
    std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    CarvedBricks all;
    for (const auto& [brick, cells] : found) {
      BrickBits once{}, twice{};
      for (std::size_t cell = 0; cell < 512; ++cell) {
        const std::uint32_t poses = cells[cell] & kCount;
        once[cell >> 6] |= static_cast<std::uint64_t>(poses >= 1) << (cell & 63);
        twice[cell >> 6] |= static_cast<std::uint64_t>(poses >= 2) << (cell & 63);
      }
      all.brick.insert(all.brick.end(), brick.begin(), brick.end());
      all.once.push_back(once);
      all.twice.push_back(twice);
    }
    return all;
  }

 private:
  static constexpr std::uint32_t kCount = 3;             // the bits of a cell that count; the others name the last pose
  static constexpr std::uint32_t kMostPoses = 1U << 29;
  static constexpr std::int32_t kMostCells = 1 << 14;    // of a ray along an axis

  void mark(std::uint32_t& value) const {
    if (value >> 2 == pose_) return;
    value = pose_ << 2 | std::min<std::uint32_t>((value & kCount) + 1, 2);
  }

  // Every cell between two points, in turn (Amanatides and Woo, 1987).
  void walk(const double* from, const double* to) {
    CellIndex cell = cell_of(from, cell_m_);
    const CellIndex last = cell_of(to, cell_m_);
    std::int32_t steps = 0, step[3];
    double next[3], apart[3];  // along the ray, of which the whole is 1
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double at = from[axis] / cell_m_, along = to[axis] / cell_m_ - at;
      const std::int32_t cells = last[axis] - cell[axis];
      if (cells > kMostCells || cells < -kMostCells) throw std::invalid_argument("a ray passes too many cells");
      steps += cells > 0 ? cells : -cells;
      step[axis] = cells > 0 ? 1 : -1;
      const double first = cells > 0 ? cell[axis] + 1 - at : at - cell[axis];
      apart[axis] = cells == 0 ? kNever : 1 / std::fabs(along);
      next[axis] = cells == 0 ? kNever : first * apart[axis];
    }
    constexpr std::int32_t kApart[3] = {64, 8, 1};  // of neighbours in a brick
    std::uint32_t* value = &grid_.at(cell);
    mark(*value);
    for (std::int32_t taken = 0; taken < steps; ++taken) {
      const std::size_t axis = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
      cell[axis] += step[axis];
      next[axis] = cell[axis] == last[axis] ? kNever : next[axis] + apart[axis];
      const bool is_next_brick = (cell[axis] & 7) == (step[axis] > 0 ? 0 : 7);
      value = is_next_brick ? &grid_.at(cell) : value + step[axis] * kApart[axis];
      mark(*value);
    }
  }

  static constexpr double kNever = 1e300;

  double cell_m_;
  BrickGrid<std::uint32_t> grid_;
  std::uint32_t pose_ = 0;
};

// Takes the cells that hold one of (count, 3) points, and the 26 around each, out of `bits` (of (n, 3) bricks, each of
// which stands once). Throws std::invalid_argument for points that are not finite, or too far from the origin.
inline void take_out_near(const std::int32_t* brick, std::size_t n, const double* points, std::size_t count, double cell_m,
                          BrickBits* bits) {
  BrickGrid<std::uint8_t> occupied(0);
  for (std::size_t i = 0; i < count; ++i) occupied.at(cell_of(points + 3 * i, cell_m)) = 1;
  for (std::size_t row = 0; row < n; ++row) {
    const CellIndex first{8 * brick[3 * row], 8 * brick[3 * row + 1], 8 * brick[3 * row + 2]};
    bool filled[10][10][10];
    bool any = false;
    for (std::int32_t x = 0; x < 10; ++x) {
      for (std::int32_t y = 0; y < 10; ++y) {
        for (std::int32_t z = 0; z < 10; ++z) {
          any |= filled[x][y][z] = occupied.get(beside(first, x - 1, y - 1, z - 1)) != 0;
        }
      }
    }
    if (!any) continue;
    for (std::size_t cell = 0; cell < 512; ++cell) {
      const std::size_t x = cell >> 6, y = cell >> 3 & 7, z = cell & 7;
      bool near = false;
      for (std::size_t i = 0; i < 27; ++i) near |= filled[x + i / 9][y + i / 3 % 3][z + i % 3];
      if (near) bits[row][x] &= ~(std::uint64_t{1} << (cell & 63));
    }
  }
}

}  // namespace firstfix
