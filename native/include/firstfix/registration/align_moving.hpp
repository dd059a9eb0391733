// Alignment of a scan that was taken in motion: the pose at the scan's stamp and the sensor's steady motion, solved together
// (docs/method.md section 7).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "firstfix/bit_exact/cholesky.hpp"
#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/rigid_motion.hpp"
#include "firstfix/registration/align.hpp"
#include "firstfix/registration/covariance.hpp"
#include "firstfix/registration/normal_equations.hpp"
#include "firstfix/registration/pairs.hpp"
#include "firstfix/registration/scan_surface.hpp"
#include "firstfix/scan/deskew.hpp"

namespace firstfix {

constexpr double kStillTwist = 0.01;  // m/s, rad/s: a step that moves no point by more than a millimetre or so

// A scan's points with their times, and the same points as they would have been seen at time 0.
class MovingScan {
 public:
  // time_s: one a point. The others: see ScanSurface.
  MovingScan(Vectors<const float> points, Vectors<const float> normals, const std::uint8_t* oriented, const float* time_s)
      : taken_(points, normals, oriented), seen_(taken_), time_s_(padded(points.size)) {
    std::copy_n(time_s, points.size, time_s_.begin());
  }

  const ScanSurface& seen() const { return seen_; }
  const float* time_s() const { return time_s_.data(); }

  // twist: linear then angular, in the sensor frame.
  void deskew(const Vector6& twist) {
    for (std::size_t i = 0; i < taken_.count; ++i) {
      const PoseAfter pose(twist, static_cast<double>(time_s_[i]));
      const double p[3] = {static_cast<double>(taken_.x[i]), static_cast<double>(taken_.y[i]), static_cast<double>(taken_.z[i])};
      const double n[3] = {static_cast<double>(taken_.nx[i]), static_cast<double>(taken_.ny[i]),
                           static_cast<double>(taken_.nz[i])};
      float* const to[6] = {&seen_.x[i], &seen_.y[i], &seen_.z[i], &seen_.nx[i], &seen_.ny[i], &seen_.nz[i]};
      for (int axis = 0; axis < 3; ++axis) {
        *to[axis] = static_cast<float>(pose.turned(axis, p[0], p[1], p[2]) + pose.t[axis]);
        *to[3 + axis] = static_cast<float>(pose.turned(axis, n[0], n[1], n[2]));
      }
    }
  }

 private:
  ScanSurface taken_, seen_;
  std::vector<float> time_s_;
};

// Normal equations of the pose and the twist: rotation then translation of the pose, then of the twist. A pair's distance
// changes with the twist as with the pose, times the time of its point.
struct MovingEquations {
  double hessian[144]{}, gradient[12]{};
  double squares = 0, weights = 1;

  static MovingEquations of(PairFinder& finder, const float* time_s, const PoseMatrix& T_level_sensor, float reach_m,
                            float half_angle) {
    const PairWeight weight_of(reach_m, half_angle);
    Float8 products[3][21]{}, pull[2][6]{}, squared{}, weighted{};  // by the power of the time
    finder.each8(T_level_sensor, [&](const Pairs8& pairs) {
      const Float8 weight = weight_of(pairs), time = load8(time_s);
      const PairJacobian jacobian(pairs);
      time_s += kLanes;
      int k = 0;
      for (int row = 0; row < 6; ++row) {
        const Float8 along = weight * jacobian.by[row], late = along * time;
        for (int column = row; column < 6; ++column, ++k) {
          const Float8 product = late * jacobian.by[column];
          products[0][k] += along * jacobian.by[column];
          products[1][k] += product;
          products[2][k] += product * time;
        }
        pull[0][row] += along * pairs.off_m;
        pull[1][row] += late * pairs.off_m;
      }
      squared += weight * pairs.off_m * pairs.off_m;
      weighted += weight;
    });
    MovingEquations equations;
    int k = 0;
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column, ++k) {
        for (int a = 0; a < 2; ++a) {
          for (int b = 0; b < 2; ++b) {
            const double total = sum(products[a + b][k]);
            equations.hessian[12 * (6 * a + row) + 6 * b + column] = total;
            equations.hessian[12 * (6 * a + column) + 6 * b + row] = total;
          }
        }
      }
      for (int a = 0; a < 2; ++a) equations.gradient[6 * a + row] = sum(pull[a][row]);
    }
    equations.squares = sum(squared);
    equations.weights = sum(weighted);
    return equations;
  }

  double variance() const { return squares / std::max(weights, 1.0) + kNoiseM * kNoiseM; }
};

namespace detail {

// The information of the pose, (6, 6), whatever the twist: Schur's complement, in units of the variance.
inline void pose_information(const double* hessian, Matrix6& information) {
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) information[6 * row + column] = hessian[12 * row + column];
  }
  for (int column = 0; column < 6; ++column) {
    double twist[36], solved[6];
    for (int k = 0; k < 6; ++k) {
      solved[k] = hessian[12 * (6 + k) + column];
      for (int j = 0; j < 6; ++j) twist[6 * k + j] = hessian[12 * (6 + k) + 6 + j];
    }
    if (!solve_definite<6>(twist, solved)) return;
    for (int row = 0; row < 6; ++row) {
      for (int k = 0; k < 6; ++k) information[6 * row + column] -= hessian[12 * row + 6 + k] * solved[k];
    }
  }
}

// Shortens a vector to what each axis of any frame may have. Rounding as the frame is turned does not exceed it either.
inline void limit(double* vector, double most) {
  const double length = std::sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
  if (length <= most) return;
  for (int k = 0; k < 3; ++k) vector[k] *= most * (1 - 1e-9) / length;
}

// Turns a twist by R, the rotation of a pose (4, 4), or by its inverse.
inline void turn_twist(const PoseMatrix& T, bool inverse, const Vector6& twist, Vector6& turned) {
  for (int half = 0; half < 6; half += 3) {
    for (int row = 0; row < 3; ++row) {
      turned[half + row] = 0;
      for (int k = 0; k < 3; ++k) turned[half + row] += (inverse ? T[4 * k + row] : T[4 * row + k]) * twist[half + k];
    }
  }
}

}  // namespace detail

// Gauss-Newton as in `align`, with the twist as six further unknowns, along the level axes.
//
// finder: of scan.seen(). scale: (6,) of the twist about 0, linear then angular, along the level axes: a tiny one keeps an axis still. The prior is
// Cauchy's: it keeps a standing sensor still, and does not hold a fast one back.
// T_level_sensor: the start, then the aligned pose at time 0. twist: the start, then that of the sensor, linear then angular, in
// the sensor frame: 0, or what is known of it. The prior is about rest whatever the start. information: of the pose, over rotation
// then translation. Returns whether pose and twist came to rest within the iterations.
inline bool align_moving(PairFinder& finder, MovingScan& scan, const AlignParameters& parameters, const Vector6& scale,
                         PoseMatrix& T_level_sensor, Vector6& twist, Matrix6& information) {
  const auto points = static_cast<double>(scan.seen().count);
  Vector6 level_twist, prior{};  // linear then angular; prior: over rotation then translation
  detail::turn_twist(T_level_sensor, false, twist, level_twist);
  scan.deskew(twist);
  MovingEquations equations;
  ShorterSteps<12> steps;
  bool rests = false;
  for (int iteration = 0; iteration < parameters.iterations && !rests; ++iteration) {
    equations = MovingEquations::of(finder, scan.time_s(), T_level_sensor, parameters.reach_m, parameters.half_angle);
    double damped[144], gradient[12], step[12];
    std::memcpy(damped, equations.hessian, sizeof damped);
    std::memcpy(step, equations.gradient, sizeof step);
    for (int k = 0; k < 6; ++k) {
      const int from = (k + 3) % 6;  // of the order linear then angular
      const double far = level_twist[from] / scale[from];
      prior[k] = kPairsPerObservation * equations.variance() / (scale[from] * scale[from] * (1 + far * far));
      damped[13 * k] += kDamping * points;
      damped[13 * (6 + k)] += prior[k];
      step[6 + k] -= prior[k] * level_twist[from];
    }
    std::memcpy(gradient, step, sizeof gradient);
    if (!solve_definite<12>(damped, step)) break;
    steps.shorten(iteration, gradient, step);
    turn_left(step, T_level_sensor);
    double turned = 0, moved = 0, changed = 0;
    for (int k = 0; k < 3; ++k) {
      T_level_sensor[4 * k + 3] += step[3 + k];
      level_twist[k] += step[9 + k];
      level_twist[3 + k] += step[6 + k];
      turned = std::max(turned, std::fabs(step[k]));
      moved = std::max(moved, std::fabs(step[3 + k]));
      changed = std::max({changed, std::fabs(step[6 + k]), std::fabs(step[9 + k])});
    }
    detail::limit(&level_twist[0], kMaxLinearMS);
    detail::limit(&level_twist[3], kMaxAngularRadS);
    detail::turn_twist(T_level_sensor, true, level_twist, twist);
    scan.deskew(twist);
    rests = turned <= kStillRad && moved <= kStillM && changed <= kStillTwist;
  }
  for (int k = 0; k < 6; ++k) equations.hessian[13 * (6 + k)] += prior[k];
  detail::pose_information(equations.hessian, information);
  const double variance = equations.variance();
  for (int k = 0; k < 36; ++k) information[k] /= variance;
  return rests;
}

}  // namespace firstfix
