// The scans of a query, ready to be described, searched for and registered (docs/method.md, section 2).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/errors.hpp"
#include "firstfix/query/joined_scans.hpp"
#include "firstfix/query/level_hypotheses.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/query/searched_query.hpp"
#include "firstfix/query/similar_places.hpp"
#include "firstfix/scan/deskew.hpp"
#include "firstfix/scan/timed_view.hpp"
#include "firstfix/verification/free_space.hpp"

namespace firstfix {

// A scan as its robot describes it, which had all points.
struct RobotDescription {
  LayeredGrid grid;
  std::vector<std::uint8_t> occupancy;  // (grid.bytes())
  detail::Vector3 up;                   // by which it was levelled
  double height_m;                      // of the sensor above the floor

  // Whether a map describes scans in the same way, with lengths as float32, as sent.
  bool agrees_with(const LayeredGrid& other) const {
    const auto is_same = [](float a, float b) { return !(a < b || a > b); };
    return grid.rings == other.rings && grid.sectors == other.sectors && is_same(grid.end_m, other.end_m) &&
           std::equal(grid.edges_m.begin(), grid.edges_m.end(), other.edges_m.begin(), other.edges_m.end(), is_same);
  }
};

// One scan of a query as it was sent, whole or compact.
struct AskedScan {
  PoseMatrix T_last_scan;       // by odometry
  Vectors<const float> points;  // of a compact scan: voxel means
  const float* time_s;          // of each point, in seconds from the stamp, or null
  const float* nearest_m;       // (kDirections) of a compact scan, infinite where nothing returned; null: it is whole
  std::optional<RobotDescription> described;
};

// What is known of the sensor, in the frame of the query's last scan.
struct SensorState {
  std::optional<detail::Vector3> gravity;  // points down; nothing: up is measured, for every scan
  detail::Vector3 up_by_mounting;          // up is sought near it
  std::optional<Vector6> twist;            // during the last scan, by which it is deskewed
};

// The numbers of a map by which queries are prepared for it.
struct QueryNumbers {
  Preparation preparation;
  double default_height_m;  // of a sensor above the floor, where no floor is seen
  double spots_apart_m;     // nearer to each other, scans show the same surfaces again
};

namespace detail {

constexpr PoseMatrix kSameFrame{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

// A compact scan whose returns have the times of its points, each in the middle of its direction.
inline void give_times(PreparedScan& made, const AskedScan& scan, const float* time_s, const Preparation& wanted) {
  const auto least = static_cast<float>(wanted.min_range_m), most = static_cast<float>(wanted.max_range_m);
  std::vector<float> in_range_m(scan.nearest_m, scan.nearest_m + kDirections);
  for (float& range_m : in_range_m) {
    if (!(range_m > least && range_m < most)) range_m = std::numeric_limits<float>::infinity();
  }
  const PointsInTime near =
      PointsInTime::within_range(scan.points.data, time_s, scan.points.size, wanted.min_range_m, wanted.max_range_m);
  made.viewed = timed_view(near.points.data(), near.times(), near.size(), in_range_m.data(), view_directions().data());
}

// The nearest ranges of a compact scan as they would have been seen at its stamp.
inline std::vector<float> nearest_at_stamp(const AskedScan& scan, const Vector6& twist) {
  const PointsInTime returns = timed_view(scan.points.data, scan.time_s, scan.points.size, scan.nearest_m, view_directions().data());
  std::vector<float> moved(returns.points.size()), nearest_m(kDirections, std::numeric_limits<float>::infinity());
  deskew({returns.points.data(), returns.size()}, returns.times(), twist, moved.data());
  firstfix::nearest_by_direction(moved.data(), returns.size(), nearest_m.data());
  return nearest_m;
}

// is_last: the motion that is solved, or known, is the last scan's.
inline std::optional<PreparedScan> prepared(const AskedScan& asked, bool is_last, const SensorState& sensor,
                                            const QueryNumbers& numbers) {
  AskedScan scan{asked.T_last_scan, asked.points, is_last ? asked.time_s : nullptr, asked.nearest_m, std::nullopt};
  std::vector<float> at_stamp, nearest_m;
  if (is_last && sensor.twist) {
    if (scan.time_s == nullptr) throw Error("invalid_option", "a twist needs the times of the scan's points");
    if (scan.nearest_m != nullptr) nearest_m = nearest_at_stamp(scan, *sensor.twist), scan.nearest_m = nearest_m.data();
    at_stamp.resize(3 * scan.points.size);
    deskew(scan.points, scan.time_s, *sensor.twist, at_stamp.data());
    scan.points.data = at_stamp.data(), scan.time_s = nullptr;
  }
  Levelling levelling{sensor.up_by_mounting, false, std::nullopt, numbers.default_height_m};
  if (asked.described) {
    levelling = {asked.described->up, true, asked.described->height_m, numbers.default_height_m};
  } else if (sensor.gravity) {
    const Vector3 down = in_scan(asked.T_last_scan, *sensor.gravity);
    levelling = {{-down[0], -down[1], -down[2]}, true, std::nullopt, numbers.default_height_m};
  }
  const Preparation& wanted = numbers.preparation;
  if (scan.nearest_m == nullptr) return prepared_scan(scan.points.data, scan.time_s, scan.points.size, wanted, levelling);
  auto made = prepared_compact_scan(scan.points.data, scan.time_s, scan.points.size, scan.nearest_m, view_directions().data(),
                                    wanted, levelling);
  if (made && made->dense.at.times() != nullptr) give_times(*made, scan, scan.time_s, wanted);
  return made;
}

}  // namespace detail

// A query keeps what is made of its scans. What it gives out refers to it.
class PreparedQuery {
 public:
  // One of the scans. Its view is in `searched`, and so are the thinned points of a scan that is alone.
  struct KeptScan {
    std::size_t number;  // among the scans that were asked
    detail::Matrix3 R_level_sensor;
    double height_m;
    std::vector<float> seen;  // (p, 3) all points within range
    ScannedSurface own;       // thinned
    std::optional<RobotDescription> described;
  };

  // Prepares a query of one scan or more, the last one last. Nothing if no scan has enough points. Throws Error "invalid_option" if
  // a twist is given, and the last scan has no times; and as voxel_box does.
  static std::optional<PreparedQuery> of(const std::vector<AskedScan>& scans, const SensorState& sensor, const QueryNumbers& numbers) {
    PreparedQuery made(sensor);
    for (const AskedScan& one : scans) {
      auto done = detail::prepared(one, &one == &scans.back(), sensor, numbers);
      if (done) made.keep(static_cast<std::size_t>(&one - scans.data()), one, std::move(*done));
    }
    if (made.scans_.empty()) return std::nullopt;
    made.join(numbers);
    return made;
  }

  const SensorState& sensor() const { return sensor_; }
  const SearchedQuery& searched() const { return searched_; }
  const std::vector<KeptScan>& scans() const { return scans_; }

  // Points of a scan in its own frame, one a voxel.
  const ScannedSurface& thinned(std::size_t scan) const { return is_alone_ ? searched_.dense : scans_[scan].own; }

  // The scans as templates are found for them. grid: of the map's descriptor; null: it is none of occupancy.
  std::vector<QueriedScan> queried(const LayeredGrid* grid) const {
    std::vector<QueriedScan> made;
    for (std::size_t i = 0; i < scans_.size(); ++i) {
      const KeptScan& one = scans_[i];
      const ScannedSurface& points = thinned(i);
      const ScanToLevel measured{searched_.scans[i].T_last_scan, one.R_level_sensor,
                                 {points.at.points.data(), points.normals.data(), points.size()}};
      const bool is_known = grid != nullptr && one.described && one.described->agrees_with(*grid);
      made.push_back({measured, one.height_m, {one.seen.data(), one.seen.size() / 3},
                      is_known ? one.described->occupancy.data() : nullptr});
    }
    return made;
  }

 private:
  explicit PreparedQuery(const SensorState& sensor) : sensor_(sensor) {}

  void keep(std::size_t number, const AskedScan& asked, PreparedScan&& made) {
    PointsInTime returns;
    if (made.viewed.times() != nullptr) returns = std::move(made.viewed);
    searched_.scans.push_back({asked.T_last_scan, std::move(made.view), std::move(returns)});
    if (scans_.empty()) searched_.sparse = std::move(made.sparse);
    scans_.push_back({number, made.R_level_sensor, made.height_m, std::move(made.seen), std::move(made.dense), asked.described});
  }

  void join(const QueryNumbers& numbers) {
    const Preparation& wanted = numbers.preparation;
    std::vector<PoseMatrix> poses;
    for (const ViewedScan& one : searched_.scans) poses.push_back(one.T_last_scan);
    searched_.spots = spots_of(poses, numbers.spots_apart_m);
    is_alone_ = scans_.size() == 1 && poses.front() == detail::kSameFrame;
    if (is_alone_) {
      searched_.dense = std::move(scans_.front().own);
      if (searched_.sparse.size() == 0) searched_.sparse = searched_.dense;
      return;
    }
    std::vector<PlacedSurface> parts;
    for (std::size_t i = 0; i < scans_.size(); ++i) parts.push_back({poses[i], &scans_[i].own});
    JoinedSurface together = joined(parts, wanted.voxel_m, wanted.dense_points, wanted.sparse_points);
    searched_.dense = std::move(together.dense), searched_.sparse = std::move(together.sparse);
  }

  SensorState sensor_;
  std::vector<KeptScan> scans_;
  SearchedQuery searched_;
  bool is_alone_ = false;
};

}  // namespace firstfix
