// Alignment of a scan with the map's surface, from a start pose (docs/method.md section 7).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

#include "firstfix/bit_exact/cholesky.hpp"
#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/rigid_motion.hpp"
#include "firstfix/registration/normal_equations.hpp"
#include "firstfix/registration/pairs.hpp"

namespace firstfix {

constexpr double kStillM = 5e-4, kStillRad = 1e-4;
constexpr double kDamping = 1e-4;  // of a pair's weight: keeps the pose along directions that the scan does not constrain
constexpr double kNoiseM = 0.01;   // standard deviation of a scan point's distance from the map, at least

struct AlignParameters {
  int iterations;
  float reach_m;     // a pair further apart has no weight
  float half_angle;  // sine between normals at which a pair counts half
};

// Shortens steps that turn back. Which points are pairs changes with the pose, so an alignment may go to and fro between two
// poses for ever, each of them best for its own pairs: it then comes to rest between them. An alignment that converges rests
// before the first step is shortened.
template <std::size_t kUnknowns>
class ShorterSteps {
 public:
  // gradient: downhill where the last step led. step: from there.
  void shorten(int iteration, const double* gradient, double* step) {
    double along = 0;
    for (std::size_t k = 0; k < kUnknowns; ++k) along += gradient[k] * last_[k];
    if (iteration >= kWholeSteps && along < 0) share_ /= 2;
    for (std::size_t k = 0; k < kUnknowns; ++k) last_[k] = step[k] *= share_;
  }

 private:
  static constexpr int kWholeSteps = 20;
  double share_ = 1, last_[kUnknowns] = {};
};

// Share of the scan's points within the inlier distance of the surface, and the same with points counting less the further
// they lie from it.
struct AlignmentQuality {
  double inlier_ratio, alignment_score;
};

// Gauss-Newton over left perturbations: rotation about the sensor, translation along the level axes.
//
// T_level_sensor: the start, then the aligned pose. information: over rotation then translation. Returns whether the pose came
// to rest within the iterations.
inline bool align(PairFinder& finder, std::size_t points, const AlignParameters& parameters, PoseMatrix& T_level_sensor,
                  Matrix6& information) {
  NormalEquations equations;
  ShorterSteps<6> steps;
  bool rests = false;
  for (int iteration = 0; iteration < parameters.iterations && !rests; ++iteration) {
    equations = NormalEquations::of(finder, T_level_sensor, parameters.reach_m, parameters.half_angle);
    double damped[36], step[6];
    std::memcpy(damped, equations.hessian, sizeof damped);
    std::memcpy(step, equations.gradient, sizeof step);
    for (int k = 0; k < 6; ++k) damped[7 * k] += kDamping * static_cast<double>(points);
    if (!solve_definite<6>(damped, step)) break;
    steps.shorten(iteration, equations.gradient, step);
    turn_left(step, T_level_sensor);
    for (int k = 0; k < 3; ++k) T_level_sensor[4 * k + 3] += step[3 + k];
    const double turned = std::max({std::fabs(step[0]), std::fabs(step[1]), std::fabs(step[2])});
    const double moved = std::max({std::fabs(step[3]), std::fabs(step[4]), std::fabs(step[5])});
    rests = turned <= kStillRad && moved <= kStillM;
  }
  const double variance = equations.squares / std::max(equations.weights, 1.0) + kNoiseM * kNoiseM;
  for (int k = 0; k < 36; ++k) information[k] = equations.hessian[k] / variance;
  return rests;
}

inline AlignmentQuality quality_at(PairFinder& finder, std::size_t points, const PoseMatrix& T_level_sensor,
                                   float inlier_distance_m) {
  Int8 inside{};
  Float8 close{};
  finder.each8(T_level_sensor, [&](const Pairs8& pairs) {
    const Float8 share = pairs.off_m / inlier_distance_m, square = share * share;
    inside -= square <= 1.0F;
    close += square < 1.0F ? 1.0F - square : Float8{};
  });
  double inliers = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) inliers += static_cast<double>(inside[lane]);
  const auto count = static_cast<double>(std::max<std::size_t>(points, 1));
  return {inliers / count, sum(close) / count};
}

}  // namespace firstfix
