// A query's points on a grid of the map, aligned pose after pose.
#pragma once

#include <vector>

#include "firstfix/query/deadline.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/searched_query.hpp"
#include "firstfix/registration/agreement.hpp"
#include "firstfix/registration/align.hpp"
#include "firstfix/registration/align_moving.hpp"
#include "firstfix/registration/pairs.hpp"
#include "firstfix/registration/scan_surface.hpp"

namespace firstfix {

namespace detail {

inline Vectors<const float> points_of(const ScannedSurface& surface) { return {surface.at.points.data(), surface.size()}; }
inline Vectors<const float> normals_of(const ScannedSurface& surface) { return {surface.normals.data(), surface.size()}; }

}  // namespace detail

// One finder serves all poses: a point that is in the same cell again finds its plane already read. The deadline is that of the query,
// and must outlive it.
class Aligner {
 public:
  Aligner(const SurfaceGrid& grid, const ScannedSurface& surface, const Deadline& deadline)
      : scan_(detail::points_of(surface), detail::normals_of(surface), surface.oriented.data()),
        finder_(grid, scan_),
        deadline_(deadline) {}
  Aligner(const Aligner&) = delete;
  Aligner& operator=(const Aligner&) = delete;

  // Throws as Deadline::left_s.
  Registration align(const PoseMatrix& T_start, const AlignParameters& parameters, double inlier_distance_m) {
    deadline_.check_wanted();
    Registration made;
    made.T_level_sensor = T_start;
    made.rests = firstfix::align(finder_, scan_.count, parameters, made.T_level_sensor, made.information);
    const InlierShares quality =
        quality_at(finder_, scan_.count, made.T_level_sensor, static_cast<float>(inlier_distance_m));
    made.inlier_ratio = quality.inlier_ratio, made.alignment_score = quality.alignment_score;
    return made;
  }

  Agreement agreement(const SurfaceGrid& coarse, const PoseMatrix& T_level_sensor, double inlier_distance_m) {
    return agreement_at(finder_, coarse, scan_, T_level_sensor, static_cast<float>(inlier_distance_m));
  }

 private:
  ScanSurface scan_;
  PairFinder finder_;
  const Deadline& deadline_;
};

// The same for points with times: the motion during the scan is solved with the pose.
class MovingAligner {
 public:
  MovingAligner(const SurfaceGrid& grid, const ScannedSurface& surface, const Vector6& twist_scale, const Deadline& deadline)
      : scan_(detail::points_of(surface), detail::normals_of(surface), surface.oriented.data(), surface.at.times()),
        finder_(grid, scan_.seen()),
        twist_scale_(twist_scale),
        deadline_(deadline) {}
  MovingAligner(const MovingAligner&) = delete;
  MovingAligner& operator=(const MovingAligner&) = delete;

  Registration align(const PoseMatrix& T_start, const Vector6& twist_start, const AlignParameters& parameters,
                     double inlier_distance_m) {
    deadline_.check_wanted();
    Registration made;
    made.T_level_sensor = T_start;
    Vector6 twist = twist_start;
    made.rests = align_moving(finder_, scan_, parameters, twist_scale_, made.T_level_sensor, twist, made.information);
    const InlierShares quality =
        quality_at(finder_, scan_.seen().count, made.T_level_sensor, static_cast<float>(inlier_distance_m));
    made.inlier_ratio = quality.inlier_ratio, made.alignment_score = quality.alignment_score;
    made.twist = twist;
    return made;
  }

 private:
  MovingScan scan_;
  PairFinder finder_;
  Vector6 twist_scale_;
  const Deadline& deadline_;
};

// A few points of a query on the map's coarse grid.
class ScanOnCells {
 public:
  // sparse: of the query. count: of the points, at most. deadline: of the query.
  ScanOnCells(const SearchedMap& map, const ScannedSurface& sparse, std::size_t count, const Deadline& deadline)
      : map_(map),
        sparse_(sparse),
        count_(count),
        deadline_(deadline),
        taken_(few_of(sparse)),
        as_taken_(map.coarse, taken_, deadline) {}

  // Poses near the starts, with their scores within one coarse cell. twist: by which the points are deskewed, if they have
  // times.
  std::vector<Registration> align(const std::vector<PoseMatrix>& T_start, const KnownTwist& twist,
                                  const AlignParameters& parameters) {
    if (!twist || sparse_.at.times() == nullptr) return align_all(as_taken_, T_start, parameters);
    const ScannedSurface few = few_of(deskewed(sparse_, *twist));
    Aligner still(map_.coarse, few, deadline_);
    return align_all(still, T_start, parameters);
  }

 private:
  ScannedSurface few_of(const ScannedSurface& surface) const {
    return at_most(surface, count_, map_.registration.coarse_voxel_m);
  }

  std::vector<Registration> align_all(Aligner& aligner, const std::vector<PoseMatrix>& T_start,
                                      const AlignParameters& parameters) const {
    std::vector<Registration> made;
    for (const PoseMatrix& T : T_start) made.push_back(aligner.align(T, parameters, map_.registration.coarse_voxel_m));
    return made;
  }

  const SearchedMap& map_;
  const ScannedSurface& sparse_;
  std::size_t count_;
  const Deadline& deadline_;
  ScannedSurface taken_;
  Aligner as_taken_;
};

// Points of a query on the map's fine grid, as they were taken, or as a motion deskews them.
class ScanOnMap {
 public:
  // deadline: of the query.
  ScanOnMap(const SearchedMap& map, const ScannedSurface& surface, const Deadline& deadline)
      : map_(map), surface_(surface), deadline_(deadline), as_taken_(map.fine, surface, deadline) {}

  // Calls use(aligner) with the points as they would have been seen at the stamp. No twist, or no times, changes nothing.
  template <class Use>
  auto seen(const KnownTwist& twist, Use use) {
    if (!twist || surface_.at.times() == nullptr) return use(as_taken_);
    Aligner still(map_.fine, deskewed(surface_, *twist), deadline_);
    return use(still);
  }

  // Aligned until nothing moves, with the motion where the times are known. Each begins with a twist, or at rest.
  std::vector<Registration> align_finely(const std::vector<PoseMatrix>& T_start, const std::vector<KnownTwist>& twist_start) {
    const double inlier_m = map_.registration.inlier_distance_m;
    std::vector<Registration> made;
    if (surface_.at.times() == nullptr) {
      for (const PoseMatrix& T : T_start) made.push_back(as_taken_.align(T, map_.finely(), inlier_m));
      return made;
    }
    MovingAligner moving(map_.fine, surface_, map_.ranking.twist_scale, deadline_);
    for (std::size_t i = 0; i < T_start.size(); ++i) {
      made.push_back(moving.align(T_start[i], twist_start[i].value_or(Vector6{}), map_.finely(), inlier_m));
    }
    return made;
  }

 private:
  const SearchedMap& map_;
  const ScannedSurface& surface_;
  const Deadline& deadline_;
  Aligner as_taken_;
};

}  // namespace firstfix
