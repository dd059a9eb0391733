// The arctangent as a fraction of a turn. Float arithmetic in a fixed order: equal to firstfix.bit_exact.atan2 to the
// last bit.
#pragma once

#include <algorithm>
#include <cmath>

namespace firstfix::detail {

constexpr double kPi = 3.14159265358979323846;

// Angle of (x, y) from the x axis in turns, -0.5 to 0.5, with the sign of y. The origin has the angle 0.
inline float atan2_turns(float y, float x) {
  constexpr float kCoefficients[] = {0.15915492F,  -0.053049516F,  0.03178285F,  -0.022312926F,
                                     0.015779652F, -0.0094682965F, 0.003860388F, -0.0007470915F};
  const float across = std::fabs(y), along = std::fabs(x);
  const float t = std::min(across, along) / std::max(std::max(across, along), 1e-30F);
  const float square = t * t;
  float angle = kCoefficients[7];
  for (int power = 6; power >= 0; --power) {
    angle *= square;
    angle += kCoefficients[power];
  }
  angle *= t;  // within the first octant
  angle = std::fabs((across > along ? 0.25F : 0.0F) - angle);
  angle = std::fabs((x < 0 ? 0.5F : 0.0F) - angle);
  return std::copysign(angle, y);
}

}  // namespace firstfix::detail
