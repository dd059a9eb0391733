// Ways to level a scan that are worth a search: several ups near the measured one, and several heights (docs/method.md
// section 7.1).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "firstfix/bit_exact/eigh3.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/scan/levelling.hpp"

namespace firstfix {

constexpr double kTiltDeg = 5.0;
constexpr std::size_t kTilts = 6;
constexpr std::size_t kMostLevelled = 18;  // each has a descriptor and a key search of its own

// Points with normals that somebody else owns, (count, 3) each.
struct SurfacePoints {
  const float *points, *normals;
  std::size_t count;
};

// A scan of a query, to be levelled otherwise.
struct ScanToLevel {
  PoseMatrix T_last_scan;
  detail::Matrix3 R_level_sensor;
  SurfacePoints thinned;
};

// One of a query's scans, levelled in one way.
struct LevelHypothesis {
  std::size_t scan;
  detail::Matrix3 R_level_sensor;
  double height_m;
};

namespace detail {

// A direction of a scan in the last scan's frame, and back.
inline Vector3 in_last(const PoseMatrix& T_last_scan, const Vector3& v) {
  Vector3 made;
  for (std::size_t i = 0; i < 3; ++i) {
    const double* row = &T_last_scan[4 * i];
    made[i] = row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
  }
  return made;
}

inline Vector3 in_scan(const PoseMatrix& T_last_scan, const Vector3& v) {
  Vector3 made;
  for (std::size_t i = 0; i < 3; ++i) made[i] = T_last_scan[i] * v[0] + T_last_scan[4 + i] * v[1] + T_last_scan[8 + i] * v[2];
  return made;
}

inline Vector3 vector_at(const float* vectors, std::size_t row) {
  const float* vector = vectors + 3 * row;
  return {static_cast<double>(vector[0]), static_cast<double>(vector[1]), static_cast<double>(vector[2])};
}

}  // namespace detail

// Mean normal, upwards, of the ground around the sensor; the expected up where there is too little. A robot stands on the slope
// that it sees.
inline detail::Vector3 ground_normal(const SurfacePoints& scan, const detail::Vector3& expected_up) {
  constexpr double kWithinM = 10, kLeastCosine = 0.8;  // of the ground's normals with up
  constexpr std::size_t kLeastPoints = 20;
  detail::Matrix3 scatter{};  // negated: its smallest eigenvector is the largest one's
  std::size_t found = 0;
  for (std::size_t i = 0; i < scan.count; ++i) {
    const detail::Vector3 normal = detail::vector_at(scan.normals, i), point = detail::vector_at(scan.points, i);
    const bool is_ground = detail::dot(point, point) < kWithinM * kWithinM &&
                           std::fabs(detail::dot(normal, expected_up)) > kLeastCosine && detail::dot(point, expected_up) < 0;
    if (!is_ground) continue;
    ++found;
    for (std::size_t row = 0; row < 3; ++row) {
      for (std::size_t column = 0; column < 3; ++column) scatter[row][column] -= normal[row] * normal[column];
    }
  }
  if (found < kLeastPoints) return expected_up;
  detail::Vector3 normal = detail::smallest_eigenvector(scatter).vector;
  if (!(detail::dot(normal, expected_up) > 0)) {
    for (double& number : normal) number = -number;
  }
  return normal;
}

// Unit vectors around an up direction, kTiltDeg from it.
inline std::vector<detail::Vector3> tilts(const detail::Vector3& up) {
  const detail::Matrix3 R = detail::levelling_rotation(up);
  const double slope = kTiltDeg * (detail::kPi / 180);
  std::vector<detail::Vector3> made;
  for (std::size_t k = 0; k < kTilts; ++k) {
    const double azimuth = static_cast<double>(k) * 2 * detail::kPi / static_cast<double>(kTilts);
    const detail::Vector3 level{std::sin(slope) * std::cos(azimuth), std::sin(slope) * std::sin(azimuth), std::cos(slope)};
    detail::Vector3 back;
    for (std::size_t i = 0; i < 3; ++i) back[i] = R[0][i] * level[0] + R[1][i] * level[1] + R[2][i] * level[2];
    made.push_back(back);
  }
  return made;
}

// The query's scans, levelled in each way that is worth a search. Of a long sequence only the last scans are taken, so that the
// work has a limit.
//
// dense: points of all scans, in the frame of the last one. expected_up: in this frame, by the mounting; nothing: up is measured,
// and only heights are varied. usual_height_m: of the map's own sensor above the floor, tried beside the height that the scan shows.
// tilted: also by small tilts about the likeliest ups, then with the usual height only.
inline std::vector<LevelHypothesis> level_hypotheses(const std::vector<ScanToLevel>& scans, const SurfacePoints& dense,
                                                     const std::optional<detail::Vector3>& expected_up, double usual_height_m,
                                                     bool tilted) {
  constexpr double kApartDeg = 2, kApartM = 0.25;  // of two ups, and of two heights, that are worth two searches
  if (scans.empty()) return {};
  const ScanToLevel& last = scans.back();
  std::vector<detail::Vector3> likely{detail::in_last(last.T_last_scan, last.R_level_sensor[2])};
  if (expected_up) {
    likely.push_back(*expected_up), likely.push_back(ground_normal(dense, *expected_up));
    for (std::size_t i = 0; tilted && i < 2; ++i) {
      const std::vector<detail::Vector3> around = tilts(likely[i]);
      likely.insert(likely.end(), around.begin(), around.end());
    }
  }
  std::vector<detail::Vector3> ups{likely.front()};
  const double nearly = std::cos(kApartDeg * (detail::kPi / 180));
  for (const detail::Vector3& up : likely) {
    const bool is_new =
        std::all_of(ups.begin(), ups.end(), [&](const detail::Vector3& other) { return detail::dot(up, other) < nearly; });
    if (is_new) ups.push_back(up);
  }
  const std::size_t taken = std::min(scans.size(), std::max<std::size_t>(1, kMostLevelled / ups.size()));
  std::vector<LevelHypothesis> made;
  for (const detail::Vector3& up : ups) {
    for (std::size_t scan = scans.size() - taken; scan < scans.size(); ++scan) {
      const SurfacePoints& thinned = scans[scan].thinned;
      const detail::Vector3 own_up = detail::in_scan(scans[scan].T_last_scan, up);
      const detail::Matrix3 R = detail::levelling_rotation(own_up);
      if (tilted) {
        made.push_back({scan, R, usual_height_m});
        continue;
      }
      const double seen_m =
          height_above_floor(thinned.points, thinned.normals, thinned.count, own_up).value_or(usual_height_m);
      made.push_back({scan, R, seen_m});
      if (std::fabs(seen_m - usual_height_m) > kApartM) made.push_back({scan, R, usual_height_m});
    }
  }
  return made;
}

}  // namespace firstfix
