// Levelling: rotations, and the height above the floor. docs/method.md, section 2. Points and normals are x y z x y z.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

// Rotates vectors in their own precision by R, row by row: (R0 x + R1 y) + R2 z. `rotated` may be `vectors`.
template <class T>
void turned(const T* vectors, std::size_t count, const double* R, T* rotated) {
  T r[9];
  std::transform(R, R + 9, r, [](double v) { return static_cast<T>(v); });
  for (std::size_t i = 0; i < 3 * count; i += 3) {
    const T x = vectors[i], y = vectors[i + 1], z = vectors[i + 2];
    rotated[i] = x * r[0] + y * r[1] + z * r[2];
    rotated[i + 1] = x * r[3] + y * r[4] + z * r[5];
    rotated[i + 2] = x * r[6] + y * r[7] + z * r[8];
  }
}

// Height of the sensor above the floor near it: the lowest height with many points on level surfaces, unless walls reach
// further down. Points and normals are levelled; `max_height_m` is at most 1000.
template <class T>
std::optional<double> floor_height(const T* points, const T* normals, std::size_t count, double max_height_m = 4.0) {
  constexpr T kRadius2 = 144, kLevelCosine = static_cast<T>(0.9659258262890683), kBinM = static_cast<T>(0.1);
  constexpr T kHighest = static_cast<T>(-0.05), kUprightCosine = static_cast<T>(0.25881904510252074);
  constexpr double kFootM = 0.15, kMinBelow = 20, kMinBelowShare = 0.01;
  const T lowest = static_cast<T>(-max_height_m);
  std::vector<T> heights, upright;
  for (std::size_t i = 0; i < 3 * count; i += 3) {
    const T x = points[i], y = points[i + 1], z = points[i + 2];
    const bool near = x * x + y * y < kRadius2;
    if (near && std::fabs(normals[i + 2]) < kUprightCosine) upright.push_back(z);
    if (near && std::fabs(normals[i + 2]) > kLevelCosine && z < kHighest && z > lowest) heights.push_back(z);
  }
  if (heights.size() < 20) return std::nullopt;
  const auto bin_of = [](T z) { return static_cast<std::ptrdiff_t>(std::floor(-z / kBinM)); };
  std::vector<std::ptrdiff_t> counts;
  for (const T z : heights) {
    const auto bin = static_cast<std::size_t>(bin_of(z));
    if (counts.size() <= bin) counts.resize(bin + 1);
    ++counts[bin];
  }
  std::vector<std::ptrdiff_t> smooth = counts;  // each bin with its two neighbours
  for (std::size_t i = 0; i + 1 < counts.size(); ++i) {
    smooth[i + 1] += counts[i];
    smooth[i] += counts[i + 1];
  }
  const auto largest = static_cast<double>(*std::max_element(smooth.begin(), smooth.end()));
  std::size_t deepest = smooth.size() - 1;
  while (static_cast<double>(smooth[deepest]) < 0.35 * largest) --deepest;
  while (deepest > 0 && smooth[deepest - 1] > smooth[deepest]) --deepest;
  std::vector<T> members;
  for (const T z : heights) {
    if (std::abs(bin_of(z) - static_cast<std::ptrdiff_t>(deepest)) <= 1) members.push_back(z);
  }
  if (members.empty()) return std::nullopt;
  const auto half = members.begin() + static_cast<std::ptrdiff_t>(members.size() / 2);
  std::nth_element(members.begin(), half, members.end());
  const bool odd = members.size() % 2 == 1;
  const T middle = odd ? *half : (*std::max_element(members.begin(), half) + *half) / 2;
  const auto height_m = static_cast<double>(-middle);
  const auto foot = static_cast<T>(-(height_m + kFootM));
  const auto below = std::count_if(upright.begin(), upright.end(), [foot](T z) { return z < foot; });
  const double too_many = std::max(kMinBelow, kMinBelowShare * static_cast<double>(upright.size()));
  if (static_cast<double>(below) >= too_many) return std::nullopt;
  return height_m;
}

namespace detail {

// R_level_sensor: the smallest rotation that brings `up` (of any length but zero) to z.
inline Matrix3 levelling_rotation(const Vector3& up) {
  const double length = std::sqrt(dot(up, up));
  const double x = up[0] / length, y = up[1] / length, z = up[2] / length;
  if (z < -1 + 1e-12) return {{{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}}};
  const double k = 1 + z;
  return {{{1 - x * x / k, -(x * y) / k, -x}, {-(x * y) / k, 1 - y * y / k, -y}, {x, y, z}}};
}

}  // namespace detail
}  // namespace firstfix
