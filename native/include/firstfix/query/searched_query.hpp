// A query's scans as a search compares them with a map.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/query/ranking.hpp"
#include "firstfix/scan/deskew.hpp"
#include "firstfix/scan/points_in_time.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/scan/voxel_filter.hpp"

namespace firstfix {

// A scan's ranges by direction, and its pose in the frame of the query's last scan.
struct ViewedScan {
  PoseMatrix T_last_scan;
  RangeView view;
  PointsInTime returns;  // of which the view was made; none, or without times: it cannot be deskewed

  // The ranges as they would have been seen at the stamp.
  RangeView deskewed(const Vector6& twist) const {
    std::vector<float> points(returns.points.size());
    firstfix::deskew({returns.points.data(), returns.size()}, returns.times(), twist, points.data());
    std::vector<float> nearest_m(kDirections, std::numeric_limits<float>::infinity());
    nearest_by_direction(points.data(), returns.size(), nearest_m.data());
    return range_view(nearest_m.data());
  }
};

struct SearchedQuery {
  std::vector<ViewedScan> scans;
  ScannedSurface dense, sparse;  // of all scans, in the frame of the last one; sparse: a part of dense
  std::size_t spots = 1;         // where the scans were taken

  bool is_in_time() const { return sparse.at.times() != nullptr; }
};

// The surface of a scan as it would have been seen at its stamp. It has times.
inline ScannedSurface deskewed(const ScannedSurface& surface, const Vector6& twist) {
  ScannedSurface seen = surface;
  const std::size_t count = surface.size();
  const Vector6 turn{0, 0, 0, twist[3], twist[4], twist[5]};
  deskew({surface.at.points.data(), count}, surface.at.times(), twist, seen.at.points.data());
  deskew({surface.normals.data(), count}, surface.at.times(), turn, seen.normals.data());
  return seen;
}

// At most `count` of a surface's points (rows_by_voxel_hash).
inline ScannedSurface at_most(const ScannedSurface& surface, std::size_t count, double voxel_m) {
  if (surface.size() <= count) return surface;
  const auto rows = rows_by_voxel_hash(surface.at.points.data(), surface.size(), voxel_m, count);
  return {surface.at.rows(rows), detail::vectors_at(surface.normals.data(), rows),
          detail::numbers_at(surface.oriented.data(), rows)};
}

}  // namespace firstfix
