// Covariance of an answered pose, from the information of its alignment (docs/method.md, section 7).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/eigh.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/registration/facing.hpp"

namespace firstfix {

namespace detail {

using Matrix3x3 = std::array<double, 9>;

// Turns, or shifts, of (6, 6) information.
inline Matrix3x3 block_of(const Matrix6& matrix, std::size_t first) {
  Matrix3x3 made;
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) made[3 * row + column] = matrix[6 * (first + row) + first + column];
  }
  return made;
}

inline Matrix6 product(const Matrix6& a, const Matrix6& b) {
  Matrix6 made{};
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = 0; column < 6; ++column) {
      for (std::size_t k = 0; k < 6; ++k) made[6 * row + column] += a[6 * row + k] * b[6 * k + column];
    }
  }
  return made;
}

inline Matrix6 transposed(const Matrix6& matrix) {
  Matrix6 made;
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = 0; column < 6; ++column) made[6 * row + column] = matrix[6 * column + row];
  }
  return made;
}

// Equal to the last bit on both sides of the diagonal.
inline Matrix6 symmetric(const Matrix6& matrix) {
  Matrix6 made;
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = 0; column < 6; ++column) {
      made[6 * row + column] = (matrix[6 * row + column] + matrix[6 * column + row]) / 2;
    }
  }
  return made;
}

// The matrix of these vectors, column by column, with these values.
inline Matrix6 matrix_of(const std::array<double, 36>& vectors, const std::array<double, 6>& values) {
  Matrix6 scaled;
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t k = 0; k < 6; ++k) scaled[6 * row + k] = vectors[6 * row + k] * values[k];
  }
  return product(scaled, transposed(vectors));
}

// Rows and columns times these numbers.
inline Matrix6 scaled_by(const Matrix6& matrix, const std::array<double, 6>& scale) {
  Matrix6 made;
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = 0; column < 6; ++column) {
      made[6 * row + column] = scale[row] * scale[column] * matrix[6 * row + column];
    }
  }
  return made;
}

// Of distances, from the sums of their weighted squares and of their weights.
inline double variance_of(double squares, double weights) {
  constexpr double kNoiseM = 0.01;  // standard deviation of a scan point's distance from the map, at least
  return squares / std::max(weights, 1.0) + kNoiseM * kNoiseM;
}

// Information less what normals tell by chance; never negative.
inline Matrix6 beyond_chance(const Matrix6& information) {
  // A few normals at edges face a free direction by chance. This share of all that the pairs tell of shifts, or of turns, is
  // taken for chance. Bare corridors and walls in simulation have up to .00006. A corridor whose doors stand 6 cm proud has
  // .0004 to .0009, and scans are right along it to 2 cm.
  constexpr double kShareByChance = 0.0001;
  std::array<double, 6> scale, per_scale;
  for (std::size_t k = 0; k < 6; ++k) {
    const std::size_t first = k < 3 ? 0 : 3;
    const double by_chance = kShareByChance * (information[7 * first] + information[7 * (first + 1)] + information[7 * (first + 2)]);
    scale[k] = std::sqrt(by_chance > 0 ? by_chance : 1.0);
    per_scale[k] = 1 / scale[k];
  }
  auto [times, vectors] = eigh<6>(symmetric(scaled_by(information, per_scale)));
  for (double& one : times) one = std::max(one - 1, 0.0);
  return scaled_by(matrix_of(vectors, times), scale);
}

}  // namespace detail

// Information of an aligned pose, over rotation then translation, less what walls seem to tell of shifts along them, and of
// turns about their normal.
//
// Normals scatter, so the walls of a bare corridor seem to tell of the shift along it, and the more points there are the
// surer. What a principal direction of shifts, or of turns, has is cut to the share that comes from the points which face it,
// with the variance of their own distances. points: of the scan, as it was seen at its stamp. reach_m: a point further from
// the surface has no weight.
inline Matrix6 faced_information(const SurfaceGrid& grid, Vectors<const float> points, const PoseMatrix& T_level_sensor,
                                 const Matrix6& information, float reach_m) {
  std::array<double, 18> axes;
  for (std::size_t part = 0; part < 2; ++part) {
    const auto vectors = eigh<3>(detail::block_of(information, 3 * part)).vectors;
    std::copy(vectors.begin(), vectors.end(), axes.begin() + 9 * static_cast<std::ptrdiff_t>(part));
  }
  const Told told = told_of(grid, points, T_level_sensor, axes.data(), reach_m);
  const double variance = detail::variance_of(told.squares, told.weights);
  Matrix6 root{};
  for (std::size_t k = 0; k < 6; ++k) {
    const std::size_t first = k < 3 ? 0 : 3;
    const double all = told.told[k] / variance;
    const double faced = told.faced_told[k] / detail::variance_of(told.faced_squares[k], told.faced_weights[k]);
    const double kept = std::sqrt(std::min(faced / (all > 0 ? all : 1.0), 1.0));
    const double* axis = axes.data() + 3 * first + (k - first);
    for (std::size_t row = 0; row < 3; ++row) {
      for (std::size_t column = 0; column < 3; ++column) {
        root[6 * (first + row) + first + column] += axis[3 * row] * kept * axis[3 * column];
      }
    }
  }
  return detail::product(detail::product(root, information), root);
}

// Covariance over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad (equation 7.3). A direction that the scan does
// not constrain (along a corridor) keeps the variance of the place, however many points there are. The variance never falls
// below a floor that the map's resolution sets.
inline Matrix6 pose_covariance(const Matrix6& information, const PoseMatrix& T_map_level, double map_voxel_m) {
  // Neighbouring pairs share the errors of the map and of the surface model, so one pair in this many counts as an independent
  // observation.
  constexpr double kPairsAnObservation = 20;
  // Known without the scan: twice what counts as the right place (1 m, 10 degrees), which is what an answer's probability is
  // about. A place further off along a free direction would tie, and nothing would be localized.
  constexpr double kPlaceM = 2, kPlaceRad = 20 * (detail::kPi / 180);
  // The map's own error, which no number of pairs averages out. Chosen by the hall and the yard (lab/docs/experiments.md): not
  // shown on other recorded places.
  constexpr double kFloorOfVoxel = 1.0 / 15, kFloorRad = 0.02 * (detail::kPi / 180);

  const std::array<double, 6> place{kPlaceRad, kPlaceRad, kPlaceRad, kPlaceM, kPlaceM, kPlaceM};
  // In units of the place its own information is 1 in every direction: what is added to it has the same eigenvectors.
  auto [times, vectors] = eigh<6>(detail::symmetric(detail::scaled_by(detail::beyond_chance(information), place)));
  for (double& one : times) one = 1 / (std::max(one, 0.0) / kPairsAnObservation + 1);
  const Matrix6 in_level = detail::scaled_by(detail::matrix_of(vectors, times), place);
  Matrix6 to_map{};  // translation comes first in the answer, last in the registration
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      to_map[6 * row + 3 + column] = to_map[6 * (3 + row) + column] = T_map_level[4 * row + column];
    }
  }
  Matrix6 covariance = detail::symmetric(detail::product(detail::product(to_map, in_level), detail::transposed(to_map)));
  const double floor_m = map_voxel_m * kFloorOfVoxel;
  for (std::size_t k = 0; k < 6; ++k) covariance[7 * k] += k < 3 ? floor_m * floor_m : kFloorRad * kFloorRad;
  return covariance;
}

// A direction of the map in which a scan leaves a pose free: a shift along it, or a turn about it.
struct FreeAxis {
  bool is_turn;
  detail::Vector3 direction;  // of unit length; its sign says nothing: the largest part is positive
  double sigma;               // standard deviation: m of a shift, rad of a turn
};

// Directions whose standard deviation is above a length, or an angle. Shifts come before turns, of each the least certain
// first; those of a kind are at right angles.
inline std::vector<FreeAxis> free_axes(const Matrix6& covariance, double above_m, double above_rad) {
  std::vector<FreeAxis> found;
  for (const bool is_turn : {false, true}) {
    const detail::Matrix3x3 part = detail::block_of(covariance, is_turn ? 3 : 0);
    const double limit = is_turn ? above_rad : above_m;
    if (part[0] + part[4] + part[8] < limit * limit) continue;  // no variance is above their sum
    const Eigensystem<3> axes = eigh<3>(part);
    for (std::size_t k = 3; k-- > 0;) {
      if (!(axes.values[k] > limit * limit)) continue;
      detail::Vector3 direction{axes.vectors[k], axes.vectors[3 + k], axes.vectors[6 + k]};
      const double largest = *std::max_element(direction.begin(), direction.end(),
                                               [](double a, double b) { return std::fabs(a) < std::fabs(b); });
      if (largest < 0) {
        for (double& one : direction) one = -one;
      }
      found.push_back({is_turn, direction, std::sqrt(axes.values[k])});
    }
  }
  return found;
}

}  // namespace firstfix
