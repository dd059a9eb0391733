// Normal equations of one Gauss-Newton step, point to plane (equation 7.0 of docs/method.md).
#pragma once

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/registration/pairs.hpp"

namespace firstfix {

// How much a pair counts: less the further apart its points and its normals are.
struct PairWeight {
  float per_reach, per_angle2;

  PairWeight(float reach_m, float half_angle) : per_reach(1 / reach_m), per_angle2(1 / (half_angle * half_angle)) {}

  Float8 operator()(const Pairs8& pairs) const {
    const Float8 share = pairs.off_m * per_reach, near = 1.0F - share * share;
    const Float8 across = 1.0F - pairs.cosine * pairs.cosine;  // squared sine between the normals
    const Float8 weight = near > 0.0F ? near * near : Float8{};  // Tukey's; 0 without a surface
    return weight / (1.0F + (across > 0.0F ? across : Float8{}) * per_angle2);
  }
};

// Of a pair's distance: by the rotation about the sensor arm x normal, by the translation the normal.
struct PairJacobian {
  Float8 by[6];

  explicit PairJacobian(const Pairs8& pairs) {
    const auto& [arm, n, off_m, cosine] = pairs;
    by[0] = arm[1] * n[2] - arm[2] * n[1], by[1] = arm[2] * n[0] - arm[0] * n[2];
    by[2] = arm[0] * n[1] - arm[1] * n[0], by[3] = n[0], by[4] = n[1], by[5] = n[2];
  }
};

struct NormalEquations {
  double hessian[36]{}, gradient[6]{};
  double squares = 0, weights = 1;  // weighted squared distances, and the weights

  static NormalEquations of(PairFinder& finder, const PoseMatrix& T_level_sensor, float reach_m, float half_angle) {
    const PairWeight weight_of(reach_m, half_angle);
    Float8 products[21]{}, pull[6]{}, squared{}, weighted{};
    finder.each8(T_level_sensor, [&](const Pairs8& pairs) {
      const Float8 weight = weight_of(pairs);
      const PairJacobian jacobian(pairs);
      int k = 0;
      for (int row = 0; row < 6; ++row) {
        const Float8 along = weight * jacobian.by[row];
        for (int column = row; column < 6; ++column) products[k++] += along * jacobian.by[column];
        pull[row] += along * pairs.off_m;
      }
      squared += weight * pairs.off_m * pairs.off_m;
      weighted += weight;
    });
    NormalEquations equations;
    int k = 0;
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        equations.hessian[6 * row + column] = equations.hessian[6 * column + row] = sum(products[k++]);
      }
      equations.gradient[row] = sum(pull[row]);
    }
    equations.squares = sum(squared);
    equations.weights = sum(weighted);
    return equations;
  }
};

}  // namespace firstfix
