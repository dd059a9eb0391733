// Further hypotheses of up for a scan whose sensor may hang head down or sit on its side (docs/method.md section 2).
//
// An estimate of up searches near the expected direction. Floors, ceilings and walls show the main axes of a place in any
// orientation of the sensor. They do not show which axis is up, nor in which sense: the map decides.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/up_vote.hpp"

namespace firstfix {

// The up vectors without those near the known one or near an earlier one.
inline std::vector<detail::Vector3> new_ups(const std::vector<detail::Vector3>& ups, const detail::Vector3& known,
                                            double apart_deg) {
  const double nearly = std::cos(apart_deg * (detail::kPi / 180));
  std::vector<detail::Vector3> kept{known};
  for (const detail::Vector3& up : ups) {
    const bool is_new = std::all_of(kept.begin(), kept.end(),
                                    [&](const detail::Vector3& other) { return detail::dot(up, other) < nearly; });
    if (is_new) kept.push_back(up);
  }
  kept.erase(kept.begin());
  return kept;
}

// Main axes of (count, 3) unit surface normals: unit vectors of any sign, up to three by votes. Most of the normals are parallel to
// an axis or at right angles to it. Where floor and ceiling are rough, every level direction may have more votes than up has: more
// normals are about at right angles to it than are about parallel to up. So where all axes lie in one plane, its normal is an axis
// too.
inline std::vector<detail::Vector3> main_axes(const float* all_normals, std::size_t count) {
  constexpr std::size_t kAxes = 3, kVoters = 1000;  // axes: the floor's normal and those of two directions of walls
  constexpr double kLeastShare = 0.5;               // of the best axis's votes: an axis with fewer comes from clutter
  const double apart = std::cos(25.0 * (detail::kPi / 180));     // nearer directions are one axis
  const double in_plane = std::cos(65.0 * (detail::kPi / 180));  // with the normal of a plane, of axes in it
  std::vector<float> normals(3 * std::min(count, kVoters));
  chosen_by_chance(all_normals, count, kVoters, normals.data());
  const std::size_t voters = normals.size() / 3;
  const std::vector<detail::Vector3> directions = detail::directions_about_z(90);
  std::vector<double> won(directions.size());
  votes(normals.data(), voters, detail::numbers_of(directions), directions.size(), won.data());
  const double least = kLeastShare * *std::max_element(won.begin(), won.end());
  std::vector<detail::Vector3> axes;
  while (axes.size() < kAxes) {
    const auto most = std::max_element(won.begin(), won.end());
    if (!(*most >= least)) break;
    const detail::Vector3 voted = directions[static_cast<std::size_t>(most - won.begin())];
    axes.push_back(refined_up(normals.data(), voters, voted));
    for (std::size_t i = 0; i < won.size(); ++i) {
      if (std::fabs(detail::dot(directions[i], voted)) > apart) won[i] = -1;
    }
  }
  if (axes.size() < kAxes) return axes;
  const auto& [a, b, c] = std::array<detail::Vector3, 3>{axes[0], axes[1], axes[2]};
  detail::Vector3 across{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  const double length = std::sqrt(detail::dot(across, across));
  if (std::fabs(detail::dot(across, c)) < in_plane * length) {
    for (double& number : across) number /= length;
    axes.push_back(refined_up(normals.data(), voters, across));
  }
  return axes;
}

// Unit up vectors to try after another one, `known`, failed. Without gravity, a direction of any length but zero: its opposite, and
// both senses of each main axis. With gravity: the vector against it, and the one that the surfaces suggest near that.
inline std::vector<detail::Vector3> other_ups(const float* normals, std::size_t count, const detail::Vector3& known,
                                              const std::optional<detail::Vector3>& gravity) {
  constexpr double kNewDeg = 10, kNewByGravityDeg = 1.5;  // nearer up directions lead to the same poses; the surfaces may correct
                                                          // a shaken IMU by little more than the second
  const auto opposite = [](const detail::Vector3& up) { return detail::Vector3{-up[0], -up[1], -up[2]}; };
  if (gravity) {
    const double length = std::sqrt(detail::dot(*gravity, *gravity));
    const detail::Vector3 measured{-(*gravity)[0] / length, -(*gravity)[1] / length, -(*gravity)[2] / length};
    return new_ups({measured, estimate_up_near(normals, count, measured)}, known, kNewByGravityDeg);
  }
  std::vector<detail::Vector3> ups{opposite(known)};
  const std::vector<detail::Vector3> axes = main_axes(normals, count);
  ups.insert(ups.end(), axes.begin(), axes.end());
  for (const detail::Vector3& axis : axes) ups.push_back(opposite(axis));
  return new_ups(ups, known, kNewDeg);
}

}  // namespace firstfix
