// The surfaces of a query's scans as one, in the frame of its last scan.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/query/searched_query.hpp"

namespace firstfix {

// A surface, and the pose of its scan in the frame of the query's last scan.
struct PlacedSurface {
  PoseMatrix T_last_scan;
  const ScannedSurface* surface;
};

struct JoinedSurface {
  ScannedSurface dense, sparse;  // sparse: a part of the points
};

// Points of all surfaces, at most so many. Where one has times, the others are taken at time 0.
inline JoinedSurface joined(const std::vector<PlacedSurface>& parts, double voxel_m, std::size_t dense_points,
                            std::size_t sparse_points) {
  const bool is_timed =
      std::any_of(parts.begin(), parts.end(), [](const PlacedSurface& one) { return one.surface->at.times() != nullptr; });
  ScannedSurface together;
  for (const PlacedSurface& one : parts) {
    const ScannedSurface& part = *one.surface;
    const FloatPose T(one.T_last_scan);
    for (std::size_t i = 0; i < part.size(); ++i) {
      const float *p = &part.at.points[3 * i], *n = &part.normals[3 * i];
      for (std::size_t row = 0; row < 3; ++row) {
        const float* R = &T.R[3 * row];
        together.at.points.push_back(R[0] * p[0] + R[1] * p[1] + R[2] * p[2] + T.t[row]);
        together.normals.push_back(R[0] * n[0] + R[1] * n[1] + R[2] * n[2]);
      }
    }
    together.oriented.insert(together.oriented.end(), part.oriented.begin(), part.oriented.end());
    if (!is_timed) continue;
    std::vector<float>& time_s = together.at.time_s;
    time_s.insert(time_s.end(), part.at.time_s.begin(), part.at.time_s.end());
    time_s.resize(together.oriented.size());
  }
  ScannedSurface sparse = at_most(together, sparse_points, voxel_m);
  return {at_most(together, dense_points, voxel_m), std::move(sparse)};
}

// Number of spots, so far apart, where scans of these poses were taken.
inline std::size_t spots_of(const std::vector<PoseMatrix>& T_last_scan, double apart_m) {
  std::vector<PoseMatrix> chosen;
  for (const PoseMatrix& T : T_last_scan) {
    const bool is_new = std::all_of(chosen.begin(), chosen.end(), [&](const PoseMatrix& other) {
      const double x = T[3] - other[3], y = T[7] - other[7], z = T[11] - other[11];
      return std::sqrt(x * x + y * y + z * z) >= apart_m;
    });
    if (is_new) chosen.push_back(T);
  }
  return chosen.size();
}

}  // namespace firstfix
