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

// Pairs that wait to be summed. A sum stays in its register for all of them, and takes them in the order of the scan.
struct HeldPairs {
  static constexpr std::size_t kMost = 16;  // of eight pairs each

  Float8 by[6][kMost], weight[kMost], off_m[kMost];
  std::size_t count = 0;

  void hold(const Pairs8& pairs, const Float8& weight_of_pairs) {
    const PairJacobian jacobian(pairs);
    for (int k = 0; k < 6; ++k) by[k][count] = jacobian.by[k];
    weight[count] = weight_of_pairs;
    off_m[count] = pairs.off_m;
    ++count;
  }
};

struct NormalEquations {
  double hessian[36]{}, gradient[6]{};
  double squares = 0, weights = 1;  // weighted squared distances, and the weights

  static NormalEquations of(PairFinder& finder, const PoseMatrix& T_level_sensor, float reach_m, float half_angle) {
    const PairWeight weight_of(reach_m, half_angle);
    Sums sums;
    HeldPairs held;
    finder.each8(T_level_sensor, [&](const Pairs8& pairs) {
      held.hold(pairs, weight_of(pairs));
      if (held.count == HeldPairs::kMost) sums.take(held);
    });
    sums.take(held);
    NormalEquations equations;
    int k = 0;
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        equations.hessian[6 * row + column] = equations.hessian[6 * column + row] = sum(sums.products[k++]);
      }
      equations.gradient[row] = sum(sums.pull[row]);
    }
    equations.squares = sum(sums.squared);
    equations.weights = sum(sums.weighted);
    return equations;
  }

 private:
  struct Sums {
    Float8 products[21]{}, pull[6]{}, squared{}, weighted{};  // products: row by row, from the diagonal on

    void take(HeldPairs& held) {
      take_row<0>(held, products);
      for (std::size_t i = 0; i < held.count; ++i) {
        squared += held.weight[i] * held.off_m[i] * held.off_m[i];
        weighted += held.weight[i];
      }
      held.count = 0;
    }

    template <int row>
    void take_row(const HeldPairs& held, Float8* of_row) {
      Float8 total[6 - row], pulled = pull[row];
      for (int k = 0; k < 6 - row; ++k) total[k] = of_row[k];
      for (std::size_t i = 0; i < held.count; ++i) {
        const Float8 along = held.weight[i] * held.by[row][i];
        for (int k = 0; k < 6 - row; ++k) total[k] += along * held.by[row + k][i];
        pulled += along * held.off_m[i];
      }
      for (int k = 0; k < 6 - row; ++k) of_row[k] = total[k];
      pull[row] = pulled;
      if constexpr (row < 5) take_row<row + 1>(held, of_row + 6 - row);
    }
  };
};

}  // namespace firstfix
