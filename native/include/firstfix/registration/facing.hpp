// What the surfaces at an aligned scan's points tell of each principal direction, and how much of it comes from those that face
// the direction (docs/method.md section 7).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/registration/surface_grid.hpp"

namespace firstfix {

// Sine. Normals of recorded maps scatter by 2 to 5 degrees. A surface that faces a direction by over 17 degrees is no wall
// along it.
constexpr float kFaces = 0.3F;

// Weighted sums over the points, for three principal turns, then for three principal shifts. told: squares of what a point's
// surface tells. The others but `told` are of the points that face the direction.
struct Told {
  std::array<double, 6> told{}, faced_told{}, faced_weights{}, faced_squares{};
  double weights = 0, squares = 0;  // of all points: weights, and weighted squared distances
};

namespace detail {

// Eight points with the planes near them.
struct Facing8 {
  Float8 arm[3], normal[3], off_m, weight;
};

class ToldSums {
 public:
  // axes: (2, 3, 3), column by column: of the turns, then of the shifts.
  explicit ToldSums(const double* axes) {
    for (std::size_t i = 0; i < 18; ++i) axes_[i] = static_cast<float>(axes[i]);
  }

  void take(const Facing8& at) {
    const Float8(&arm)[3] = at.arm, (&n)[3] = at.normal;
    const Float8 turn[3] = {arm[1] * n[2] - arm[2] * n[1], arm[2] * n[0] - arm[0] * n[2], arm[0] * n[1] - arm[1] * n[0]};
    const Float8 lever2 = arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2];
    const Float8 square = at.weight * (at.off_m * at.off_m);
    for (std::size_t k = 0; k < 6; ++k) {
      const bool is_turn = k < 3;
      const float* axis = axes_ + (is_turn ? k : 9 + k - 3);
      const Float8 told = along(is_turn ? turn : n, axis), told2 = told * told, by = along(arm, axis);
      const Float8 lever = is_turn ? lever2 - by * by : all8(1);
      const Float8 faced = told2 > kFaces * kFaces * lever ? at.weight : Float8{};
      told_[k] += at.weight * told2;
      faced_told_[k] += faced * told2;
      faced_weights_[k] += faced;
      faced_squares_[k] += faced * (at.off_m * at.off_m);
    }
    weights_ += at.weight;
    squares_ += square;
  }

  Told total() const {
    Told made;
    for (std::size_t k = 0; k < 6; ++k) {
      made.told[k] = sum(told_[k]), made.faced_told[k] = sum(faced_told_[k]);
      made.faced_weights[k] = sum(faced_weights_[k]), made.faced_squares[k] = sum(faced_squares_[k]);
    }
    made.weights = sum(weights_), made.squares = sum(squares_);
    return made;
  }

 private:
  float axes_[18];
  Float8 told_[6]{}, faced_told_[6]{}, faced_weights_[6]{}, faced_squares_[6]{}, weights_{}, squares_{};

  static Float8 along(const Float8 (&vector)[3], const float* axis) {
    return vector[0] * axis[0] + vector[1] * axis[3] + vector[2] * axis[6];
  }
};

}  // namespace detail

// axes: (2, 3, 3), column by column: of the turns about the sensor, then of the shifts, along the level axes.
// reach_m: a point further from the surface has no weight.
inline Told told_of(const SurfaceGrid& grid, Vectors<const float> points, const PoseMatrix& T_level_sensor,
                    const double* axes, float reach_m) {
  constexpr std::size_t kBlock = 256;
  const auto [R, t] = FloatPose(T_level_sensor, grid.corner_m);
  const float per_m = 1 / grid.cell_m, per_reach = 1 / reach_m;
  detail::ToldSums sums(axes);
  float arm[3][kBlock], normal[3][kBlock], off_m[kBlock], weight[kBlock];
  std::int32_t cell[3][kBlock], row[kBlock];
  for (std::size_t first = 0; first < points.size; first += kBlock) {
    const std::size_t count = std::min(kBlock, points.size - first);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float* r = R + 3 * axis;
      for (std::size_t i = 0; i < count; ++i) {
        const float* p = points[first + i];
        arm[axis][i] = r[0] * p[0] + r[1] * p[1] + r[2] * p[2];
        cell[axis][i] = cell_at((arm[axis][i] + t[axis]) * per_m, grid.last(static_cast<int>(axis)));
      }
    }
    grid.nearest(cell[0], cell[1], cell[2], count, row);
    for (std::size_t i = 0; i < padded(count); ++i) {
      const bool is_there = i < count && row[i] >= 0;
      const Plane plane = is_there ? grid.planes[row[i]] : Plane{0, 0, 0, 0};
      if (i >= count) arm[0][i] = arm[1][i] = arm[2][i] = 0;
      normal[0][i] = plane.nx, normal[1][i] = plane.ny, normal[2][i] = plane.nz;
      off_m[i] = plane.off_m - ((arm[0][i] + t[0]) * plane.nx + (arm[1][i] + t[1]) * plane.ny + (arm[2][i] + t[2]) * plane.nz);
      const float share = off_m[i] * per_reach, near = 1.0F - share * share;
      weight[i] = is_there && near > 0 ? near * near : 0.0F;  // Tukey's
    }
    for (std::size_t i = 0; i < count; i += kLanes) {
      sums.take({{load8(&arm[0][i]), load8(&arm[1][i]), load8(&arm[2][i])},
                 {load8(&normal[0][i]), load8(&normal[1][i]), load8(&normal[2][i])},
                 load8(&off_m[i]),
                 load8(&weight[i])});
    }
  }
  return sums.total();
}

}  // namespace firstfix
