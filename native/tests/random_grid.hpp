// Poses and tables of grids that hold any numbers.
#pragma once

#include <vector>

#include "firstfix/bit_exact/rigid_motion.hpp"
#include "firstfix/registration/surface_grid.hpp"
#include "hostile.hpp"

namespace firstfix::tests {

inline PoseMatrix pose(Hostile& random, double wrong) {
  PoseMatrix T{};
  for (int k = 0; k < 4; ++k) T[5 * k] = 1;
  const double turn[3] = {random.real(0.5, 0), random.real(0.5, 0), random.real(3, 0)};
  turn_left(turn, T);
  for (int axis = 0; axis < 3; ++axis) T[4 * axis + 3] = random.real(8, wrong);
  if (random.chance(wrong)) T[random.number(0, 15)] = random.real(3, 1);
  return T;
}

// A grid of random tables. Each vector is as long as the grid says, so that a read beyond it is found.
struct RandomGrid {
  int side_bits, block_bits;
  std::vector<std::int32_t> group, block, point;
  std::vector<Plane> planes;
  std::vector<std::uint8_t> oriented;
  std::vector<std::int32_t> other_face;
  SurfaceGrid grid;

  RandomGrid(Hostile& random, double wrong)
      : side_bits(static_cast<int>(random.number(0, 3))), block_bits(static_cast<int>(random.number(0, 3))) {
    const std::int32_t shape[3] = {static_cast<std::int32_t>(random.number(1, 6)),
                                   static_cast<std::int32_t>(random.number(1, 6)),
                                   static_cast<std::int32_t>(random.number(1, 4))};
    const std::int64_t groups = random.number(1, 9), blocks = random.number(1, 40), rows = random.number(1, 300);
    group = random.pointers(static_cast<std::size_t>(shape[0] * shape[1] * shape[2]), groups, wrong);
    block = random.pointers(static_cast<std::size_t>(groups) << 3 * side_bits, blocks, wrong);
    point = random.pointers(static_cast<std::size_t>(blocks) << 3 * block_bits, rows, wrong);
    const std::vector<float> numbers = random.floats(static_cast<std::size_t>(4 * rows), 1, wrong);
    for (std::int64_t row = 0; row < rows; ++row) {
      const float* plane = &numbers[4 * row];
      planes.push_back({plane[0], plane[1], plane[2], 5 * plane[3]});
      oriented.push_back(static_cast<std::uint8_t>(random.number(0, 255)));
    }
    other_face = random.pointers(static_cast<std::size_t>(rows), rows, wrong);
    const float cell_m = random.chance(0.1) ? 1e-30F : 0.4F;
    grid = {cell_m, {-4, -4, -2}, planes.data(), oriented.data(), other_face.data(), static_cast<std::uint32_t>(rows),
            group.data(), {shape[0], shape[1], shape[2]}, block.data(), static_cast<std::uint32_t>(groups), point.data(),
            static_cast<std::uint32_t>(blocks), side_bits, block_bits};
  }
};

}  // namespace firstfix::tests
