// Estimates of the up direction and of the height above the floor: docs/method.md, section 6.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "firstfix/portable/atan2.hpp"
#include "firstfix/portable/eigh3.hpp"
#include "firstfix/portable/vector3.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix::detail {

// R_level_sensor: the smallest rotation that brings `up` (of any length but zero) to z.
inline Matrix3 levelling_rotation(const Vector3& up) {
  const double length = std::sqrt(dot(up, up));
  const double x = up[0] / length, y = up[1] / length, z = up[2] / length;
  if (z < -1 + 1e-12) return {{{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}}};
  const double k = 1 + z;
  return {{{1 - x * x / k, -(x * y) / k, -x}, {-(x * y) / k, 1 - y * y / k, -y}, {x, y, z}}};
}

inline Vector3 rotated(const Vector3& p, const Matrix3& R) { return {dot(R[0], p), dot(R[1], p), dot(R[2], p)}; }

// Directions within 35 degrees of z, about four degrees apart.
inline std::vector<Vector3> up_candidates() {
  std::vector<Vector3> directions{{0, 0, 1}};
  for (int tilt_deg = 4; tilt_deg <= 35; tilt_deg += 4) {
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

// Score of one up direction: normals parallel or perpendicular to it vote for it.
inline double votes(const std::vector<Vector3>& normals, const Vector3& direction) {
  const double width = 5.0 * (kPi / 180);
  const auto scale = static_cast<float>(-1 / (2 * width * width));
  const auto x = static_cast<float>(direction[0]), y = static_cast<float>(direction[1]),
             z = static_cast<float>(direction[2]);
  double sum = 0;
  for (const Vector3& n : normals) {
    const float along = static_cast<float>(n[0]) * x + static_cast<float>(n[1]) * y + static_cast<float>(n[2]) * z;
    const float along2 = along * along;
    sum += static_cast<double>(std::exp(along2 * scale) + std::exp((1 - along2) * scale));
  }
  const double tilt_deg = std::acos(std::clamp(direction[2], -1.0, 1.0)) * (180 / kPi);
  return sum * (1 - 0.15 * tilt_deg / 35.0);
}

// The up direction that most of the unit surface normals (of either sign) confirm.
inline Vector3 estimate_up(const std::vector<Vector3>& all_normals) {
  constexpr std::size_t kVoters = 2000;
  const std::vector<Vector3> normals = at_most(all_normals, kVoters);
  Vector3 up{0, 0, 1};
  double most = -1;
  for (const Vector3& direction : up_candidates()) {
    const double won = votes(normals, direction);
    if (won > most) {
      most = won;
      up = direction;
    }
  }
  for (const double width_deg : {5.0, 2.5, 1.5}) {
    const double width = width_deg * (kPi / 180), scale = 2 * width * width;
    Matrix3 scatter{};
    for (const Vector3& n : normals) {
      const double along = dot(n, up);
      const double weight = std::exp(-(along * along) / scale) - 0.1 * std::exp(-(1 - along * along) / scale);
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) scatter[i][j] += n[i] * weight * n[j];
      }
    }
    Vector3 refined = smallest_eigenvector(scatter).vector;
    double agrees = dot(refined, up);
    if (!(agrees > 0)) {
      for (double& v : refined) v = -v;
      agrees = -agrees;
    }
    if (agrees < std::cos(6.0 * (kPi / 180))) break;  // one direction is not constrained: keep the vote
    up = refined;
  }
  return up;
}

// Height of the sensor above the floor near it: the lowest height with many points on level surfaces.
inline std::optional<double> floor_height(const std::vector<Vector3>& points, const std::vector<Vector3>& normals) {
  std::vector<double> heights;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto& [x, y, z] = points[i];
    if (x * x + y * y < 144.0 && std::fabs(normals[i][2]) > 0.9659258262890683 && z < -0.05 && z > -4.0) {
      heights.push_back(z);
    }
  }
  if (heights.size() < 20) return std::nullopt;
  const auto bin_of = [](double z) { return static_cast<std::ptrdiff_t>(std::floor(-z / 0.1)); };
  std::vector<std::ptrdiff_t> counts;
  for (const double z : heights) {
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
  std::vector<double> members;
  for (const double z : heights) {
    if (std::abs(bin_of(z) - static_cast<std::ptrdiff_t>(deepest)) <= 1) members.push_back(z);
  }
  if (members.empty()) return std::nullopt;
  std::sort(members.begin(), members.end());
  const std::size_t half = members.size() / 2;
  return -(members.size() % 2 == 1 ? members[half] : (members[half - 1] + members[half]) / 2);
}

}  // namespace firstfix::detail
