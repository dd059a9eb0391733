// The exponential of numbers up to 0, in plain arithmetic: a loop over it becomes vector instructions, and its results
// do not depend on a library or a processor. The relative error is below 2e-7 in float and 1e-15 in double.
#pragma once

#include <cstdint>
#include <cstring>

namespace firstfix::detail {

// Below the limit, and for NaN, the result is that of the limit, which is as good as 0.
inline float exp_of_negative(float x) {
  constexpr float kLimit = -86.0F, kRounder = 12582912.0F;  // adding 1.5 * 2^23 rounds to an integer
  x = kLimit < x ? x : kLimit;
  const float shifted = x * 1.44269504F + kRounder;
  const float twos = shifted - kRounder;
  const float rest = (x - twos * 0.693359375F) + twos * 2.12194440e-4F;
  float p = 1.9875691500e-4F;
  p = p * rest + 1.3981999507e-3F;
  p = p * rest + 8.3334519073e-3F;
  p = p * rest + 4.1665795894e-2F;
  p = p * rest + 1.6666665459e-1F;
  p = p * rest + 5.0000001201e-1F;
  p = p * rest * rest + rest + 1.0F;
  std::uint32_t bits;
  std::memcpy(&bits, &shifted, sizeof bits);
  bits = (bits << 23) + 0x3f800000U;  // 2 to the power of that integer
  float scale;
  std::memcpy(&scale, &bits, sizeof scale);
  return p * scale;
}

inline double exp_of_negative(double x) {
  constexpr double kLimit = -700.0, kRounder = 6755399441055744.0;  // 1.5 * 2^52
  x = kLimit < x ? x : kLimit;
  const double shifted = x * 1.4426950408889634 + kRounder;
  const double twos = shifted - kRounder;
  const double rest = (x - twos * 6.93147180369123816490e-01) - twos * 1.90821492927058770002e-10;
  double p = 1.0 / 6227020800.0;  // Taylor's series: rest is within 0.35
  p = p * rest + 1.0 / 479001600.0;
  p = p * rest + 1.0 / 39916800.0;
  p = p * rest + 1.0 / 3628800.0;
  p = p * rest + 1.0 / 362880.0;
  p = p * rest + 1.0 / 40320.0;
  p = p * rest + 1.0 / 5040.0;
  p = p * rest + 1.0 / 720.0;
  p = p * rest + 1.0 / 120.0;
  p = p * rest + 1.0 / 24.0;
  p = p * rest + 1.0 / 6.0;
  p = p * rest + 0.5;
  p = p * rest * rest + rest + 1.0;
  std::uint64_t bits;
  std::memcpy(&bits, &shifted, sizeof bits);
  bits = (bits << 52) + 0x3ff0000000000000ULL;
  double scale;
  std::memcpy(&scale, &bits, sizeof scale);
  return p * scale;
}

}  // namespace firstfix::detail
