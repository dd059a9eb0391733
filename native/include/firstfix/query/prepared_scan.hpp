// A scan, ready to be described and registered: in range, thinned, with normals, levelled (docs/method.md, section 2).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/registration/normals.hpp"
#include "firstfix/scan/levelling.hpp"
#include "firstfix/scan/points_in_time.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/scan/up_vote.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix {

// What a map wants of a scan: lengths, and numbers of points.
struct Preparation {
  double min_range_m, max_range_m, voxel_m;
  std::size_t min_points;  // voxels, in which a scan with fewer points is not prepared
  std::size_t voxelled_points, view_points, dense_points, sparse_points;  // at most
};

// Which way is up: known, or to be found near where it is expected; and the height above the floor, where it is known.
struct Levelling {
  detail::Vector3 up;
  bool is_known;
  std::optional<double> height_m;
  double default_height_m;  // where no floor is seen
};

// Points with normals. oriented: not 0 where the normal surely points to the viewer.
struct ScannedSurface {
  PointsInTime at;
  std::vector<float> normals;          // (n, 3)
  std::vector<std::uint8_t> oriented;  // (n)

  std::size_t size() const { return oriented.size(); }
};

struct PreparedScan {
  std::vector<float> seen;  // (p, 3) all points within range
  RangeView view;
  PointsInTime viewed;    // of which the view was made; of a compact scan none
  ScannedSurface dense;   // one point a voxel
  ScannedSurface sparse;  // a part of them; none if there are no more
  detail::Matrix3 R_level_sensor{};
  double height_m = 0;
};

// Height of the sensor above the floor, for an up direction.
inline std::optional<double> height_above_floor(const float* points, const float* normals, std::size_t count,
                                                const detail::Vector3& up) {
  const detail::Matrix3 R = detail::levelling_rotation(up);
  std::vector<float> places(3 * count), turns(3 * count);
  turned(points, count, R[0].data(), places.data());
  turned(normals, count, R[0].data(), turns.data());
  return floor_height(places.data(), turns.data(), count);
}

namespace detail {

// Fills in what follows from the points of the voxels. False if they are too few.
inline bool finish(PreparedScan& made, const Preparation& wanted, const Levelling& levelling) {
  ScannedSurface& dense = made.dense;
  const std::size_t count = dense.at.size();
  if (count < wanted.min_points) return false;
  const std::vector<float>& points = dense.at.points;
  std::vector<float> to_viewer(3 * count);
  for (std::size_t i = 0; i < 3 * count; ++i) to_viewer[i] = -points[i];
  dense.normals.resize(3 * count), dense.oriented.resize(count);
  surface_normals({points.data(), count}, to_viewer.data(), false, dense.normals.data(), dense.oriented.data());
  const Vector3 up = levelling.is_known ? levelling.up : estimate_up_near(dense.normals.data(), count, levelling.up);
  made.R_level_sensor = levelling_rotation(up);
  made.height_m = levelling.height_m ? *levelling.height_m
                                     : height_above_floor(points.data(), dense.normals.data(), count, up)
                                           .value_or(levelling.default_height_m);
  if (count <= wanted.sparse_points) return true;
  const auto rows = rows_by_voxel_hash(points.data(), count, wanted.voxel_m, wanted.sparse_points);
  made.sparse.at = dense.at.rows(rows);
  made.sparse.normals = vectors_at(dense.normals.data(), rows);
  made.sparse.oriented = numbers_at(dense.oriented.data(), rows);
  return true;
}

}  // namespace detail

// Prepares a whole scan of (count, 3) points. time_s: one a point, in seconds from the stamp, or null. Nothing if too few
// voxels have points. Throws as voxel_box does.
inline std::optional<PreparedScan> prepared_scan(const float* points, const float* time_s, std::size_t count,
                                                 const Preparation& wanted, const Levelling& levelling) {
  PreparedScan made;
  time_s = sweep_times(time_s, count);
  PointsInTime near = PointsInTime::within_range(points, time_s, count, wanted.min_range_m, wanted.max_range_m);
  {
    const PointsInTime some = near.at_most(wanted.voxelled_points);
    TimedMeans means;
    if (some.times() == nullptr) {
      means.points = voxel_means(some.points.data(), some.size(), wanted.voxel_m, kBorderM);
    } else {
      means = timed_voxel_means(some.points.data(), some.times(), some.size(), wanted.voxel_m, kBorderM);
    }
    const auto rows = rows_by_voxel_hash(means.points.data(), means.points.size() / 3, wanted.voxel_m, wanted.dense_points);
    made.dense.at.points = detail::vectors_at<float>(means.points.data(), rows);
    if (!means.time_s.empty()) made.dense.at.time_s = detail::numbers_at<float>(means.time_s.data(), rows);
  }
  made.viewed = near.at_most(wanted.view_points);
  std::vector<float> nearest_m(kDirections, std::numeric_limits<float>::infinity());
  nearest_by_direction(made.viewed.points.data(), made.viewed.size(), nearest_m.data());
  made.view = range_view(nearest_m.data());
  made.seen = std::move(near.points);
  if (!detail::finish(made, wanted, levelling)) return std::nullopt;
  return made;
}

// Prepares a compact scan: (count, 3) voxel means, and the nearest range in each of kDirections directions, (kDirections, 3)
// unit vectors. Its descriptor is made of both: ranges fill cells that the voxels leave empty. Otherwise as prepared_scan.
inline std::optional<PreparedScan> prepared_compact_scan(const float* points, const float* time_s, std::size_t count,
                                                         const float* nearest_m, const float* directions,
                                                         const Preparation& wanted, const Levelling& levelling) {
  PreparedScan made;
  const auto least = static_cast<float>(wanted.min_range_m), most = static_cast<float>(wanted.max_range_m);
  std::vector<float> in_range_m(nearest_m, nearest_m + kDirections);
  PointsInTime near =
      PointsInTime::within_range(points, sweep_times(time_s, count), count, wanted.min_range_m, wanted.max_range_m);
  const auto rows = rows_by_voxel_hash(near.points.data(), near.size(), wanted.voxel_m, wanted.dense_points);
  made.dense.at = near.rows(rows);
  made.seen = std::move(near.points);
  for (std::size_t i = 0; i < kDirections; ++i) {
    const float range_m = in_range_m[i];
    if (!(range_m > least && range_m < most)) {
      in_range_m[i] = std::numeric_limits<float>::infinity();
      continue;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) made.seen.push_back(directions[3 * i + axis] * range_m);
  }
  made.view = range_view(in_range_m.data());
  if (!detail::finish(made, wanted, levelling)) return std::nullopt;
  return made;
}

}  // namespace firstfix
