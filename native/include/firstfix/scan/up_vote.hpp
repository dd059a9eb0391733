// The vote of surface normals on the up direction: docs/method.md, (2.1) and (2.2). Normals are x y z x y z, of either
// sign. Sums are in a fixed order, so that the result does not depend on the instruction set.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/eigh3.hpp"
#include "firstfix/bit_exact/exp.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/levelling.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix {

// Votes of unit normals for each of `candidates` directions as up: normals parallel or at right angles to it vote.
template <class T>
void votes(const T* normals, std::size_t count, const double* directions, std::size_t candidates, double* won) {
  constexpr std::size_t kInStep = 16, kRows = 8;  // float sums of so many rows, then double
  constexpr double kWidth = 5.0 * (detail::kPi / 180);
  constexpr auto kScale = static_cast<float>(-1 / (2 * kWidth * kWidth));
  const float whole = detail::exp_of_negative(kScale);
  const std::size_t padded = (count + kInStep - 1) / kInStep * kInStep;
  std::vector<float> x(padded), y(padded), z(padded), counts(padded);
  for (std::size_t i = 0; i < count; ++i) {
    x[i] = static_cast<float>(normals[3 * i]);
    y[i] = static_cast<float>(normals[3 * i + 1]);
    z[i] = static_cast<float>(normals[3 * i + 2]);
    counts[i] = 1;
  }
  float upright[kInStep * kRows];
  for (std::size_t d = 0; d < candidates; ++d) {
    const auto a = static_cast<float>(directions[3 * d]), b = static_cast<float>(directions[3 * d + 1]),
               c = static_cast<float>(directions[3 * d + 2]);
    double sum[kInStep] = {};
    for (std::size_t start = 0; start < padded; start += kInStep * kRows) {
      const std::size_t end = std::min(padded, start + kInStep * kRows);
      // Three short loops: a processor then has many numbers under way at once. In one loop, each number's long chain of
      // operations fills its queue.
      for (std::size_t i = start; i < end; ++i) {
        const float along = x[i] * a + y[i] * b + z[i] * c;
        upright[i - start] = along * along * kScale;
      }
      for (std::size_t i = 0; i < end - start; ++i) upright[i] = detail::exp_of_negative(upright[i]);
      float part[kInStep] = {};
      for (std::size_t i = start; i < end; i += kInStep) {
        for (std::size_t lane = 0; lane < kInStep; ++lane) {
          const float level = whole / upright[i - start + lane];  // exp(s - t) is exp(s) / exp(t)
          part[lane] += (upright[i - start + lane] + level) * counts[i + lane];
        }
      }
      for (std::size_t lane = 0; lane < kInStep; ++lane) sum[lane] += static_cast<double>(part[lane]);
    }
    won[d] = 0;
    for (const double part : sum) won[d] += part;
  }
}

// The unit up vector, refined from a direction that the unit normals voted for: three rounds of reweighted least
// squares.
template <class T>
detail::Vector3 refined_up(const T* normals, std::size_t count, detail::Vector3 up) {
  constexpr std::size_t kInStep = 8;
  constexpr double kLevelWeight = 0.1;  // of a level surface against an upright one
  const double nearly = std::cos(6.0 * (detail::kPi / 180));
  const std::size_t padded = (count + kInStep - 1) / kInStep * kInStep;
  std::vector<double> x(padded), y(padded), z(padded);  // a padding of zeros adds nothing to the scatter
  for (std::size_t i = 0; i < count; ++i) {
    x[i] = static_cast<double>(normals[3 * i]);
    y[i] = static_cast<double>(normals[3 * i + 1]);
    z[i] = static_cast<double>(normals[3 * i + 2]);
  }
  for (const double width_deg : {5.0, 2.5, 1.5}) {
    const double width = width_deg * (detail::kPi / 180), scale = -1 / (2 * width * width);
    double sum[6][kInStep] = {};
    for (std::size_t i = 0; i < padded; i += kInStep) {
      for (std::size_t lane = 0; lane < kInStep; ++lane) {
        const double nx = x[i + lane], ny = y[i + lane], nz = z[i + lane];
        const double along = nx * up[0] + ny * up[1] + nz * up[2], along2 = along * along;
        const double weight = detail::exp_of_negative(along2 * scale) -
                              kLevelWeight * detail::exp_of_negative((1 - along2) * scale);
        const double wx = weight * nx, wy = weight * ny, wz = weight * nz;
        sum[0][lane] += wx * nx;
        sum[1][lane] += wx * ny;
        sum[2][lane] += wx * nz;
        sum[3][lane] += wy * ny;
        sum[4][lane] += wy * nz;
        sum[5][lane] += wz * nz;
      }
    }
    double s[6] = {};
    for (std::size_t k = 0; k < 6; ++k) {
      for (const double part : sum[k]) s[k] += part;
    }
    const detail::Matrix3 scatter{{{s[0], s[1], s[2]}, {s[1], s[3], s[4]}, {s[2], s[4], s[5]}}};
    detail::Vector3 refined = detail::smallest_eigenvector(scatter).vector;
    double agrees = detail::dot(refined, up);
    if (!(agrees > 0)) {
      for (double& v : refined) v = -v;
      agrees = -agrees;
    }
    if (agrees < nearly) break;  // one direction is not constrained: keep the vote
    up = refined;
  }
  return up;
}

namespace detail {

// Directions within so many degrees of z, about four degrees apart.
inline std::vector<Vector3> directions_about_z(int within_deg) {
  std::vector<Vector3> directions{{0, 0, 1}};
  for (int tilt_deg = 4; tilt_deg <= within_deg; tilt_deg += 4) {
    const double tilt = tilt_deg * (kPi / 180);
    const double around = std::max(6.0, std::nearbyint(2 * kPi * std::sin(tilt) / (4.0 * (kPi / 180))));
    for (int k = 0; k < static_cast<int>(around); ++k) {
      const double azimuth = k * (2 * kPi / around);
      directions.push_back(
          {std::sin(tilt) * std::cos(azimuth), std::sin(tilt) * std::sin(azimuth), std::cos(tilt)});
    }
  }
  return directions;
}

// The up direction that most of (count, 3) unit surface normals, of either sign, confirm.
template <class T>
Vector3 estimate_up(const T* all_normals, std::size_t count) {
  constexpr std::size_t kVoters = 2000;
  std::vector<T> normals;
  for (const auto row : rows_by_chance(count, kVoters)) {
    normals.insert(normals.end(), all_normals + 3 * row, all_normals + 3 * row + 3);
  }
  const std::vector<Vector3> directions = directions_about_z(35);
  std::vector<double> won(directions.size());
  votes(normals.data(), normals.size() / 3, numbers_of(directions), directions.size(), won.data());
  for (std::size_t i = 0; i < won.size(); ++i) {  // a weak preference for an upright sensor
    const double tilt_deg = std::acos(std::clamp(directions[i][2], -1.0, 1.0)) * (180 / kPi);
    won[i] *= 1 - 0.15 * tilt_deg / 35.0;
  }
  const auto voted = static_cast<std::size_t>(std::max_element(won.begin(), won.end()) - won.begin());
  return refined_up(normals.data(), normals.size() / 3, directions[voted]);
}

}  // namespace detail

// The unit up vector by (count, 3) normals, within 35 degrees of an expected one.
inline detail::Vector3 estimate_up_near(const float* normals, std::size_t count, const detail::Vector3& expected) {
  const detail::Matrix3 R = detail::levelling_rotation(expected);
  std::vector<float> levelled(3 * count);
  turned(normals, count, R[0].data(), levelled.data());
  const detail::Vector3 up = detail::estimate_up(levelled.data(), count);
  detail::Vector3 back;
  for (std::size_t k = 0; k < 3; ++k) back[k] = R[0][k] * up[0] + R[1][k] * up[1] + R[2][k] * up[2];
  return back;
}

}  // namespace firstfix
