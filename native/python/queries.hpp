// The scans of a query, and the poses that were found for it, as Python hands them over and gets them.
#pragma once

#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "candidates.hpp"
#include "firstfix/query/registered_pose.hpp"
#include "firstfix/query/searched_query.hpp"
#include "grid.hpp"

namespace firstfix::python {

using Points = In<float, nb::shape<-1, 3>>;
using Directions = nb::shape<static_cast<nb::ssize_t>(kDirections)>;
using Scanned = std::tuple<Points, Points, Flags, std::optional<Times>>;  // points, normals, oriented, times
// T_last_scan, the view's returned and least_m, and its points with their times if they have any
using Viewed = std::tuple<PoseArray, In<bool, Directions>, In<float, Directions>, std::optional<std::tuple<Points, Times>>>;
using Doubles = nb::ndarray<nb::numpy, double>;
// A pose: row of the template, start_z_m, T_level_sensor, inlier_ratio, alignment_score, information, rests, twist,
// free_space_violation, removed_surface, seen_free, beside_surface, same_plane, is_alike, the alignment score less what an unlikely
// motion takes from it, support.
using Found = std::tuple<std::int64_t, double, Doubles, double, double, Doubles, bool, std::optional<Doubles>, double, double,
                         std::optional<double>, double, double, bool, double, double>;

inline ScannedSurface surface_of(const Scanned& scanned) {
  const auto& [points, normals, oriented, time_s] = scanned;
  const std::size_t size = points.shape(0);
  require(normals.shape(0) == size && oriented.shape(0) == size, "points, normals and oriented differ in length");
  ScannedSurface made;
  made.at.points.assign(points.data(), points.data() + 3 * size);
  made.normals.assign(normals.data(), normals.data() + 3 * size);
  made.oriented.assign(bytes_of(oriented), bytes_of(oriented) + size);
  if (time_s) {
    check_times(*time_s, size);
    made.at.time_s.assign(time_s->data(), time_s->data() + size);
  }
  return made;
}

inline ViewedScan scan_of(const Viewed& viewed) {
  const auto& [T_last_scan, returned, least, returns] = viewed;
  const auto* is_returned = reinterpret_cast<const std::uint8_t*>(returned.data());
  ViewedScan made{pose_of(T_last_scan),
                  {{is_returned, is_returned + kDirections}, {least.data(), least.data() + kDirections}},
                  {}};
  if (returns) {
    const auto& [points, time_s] = *returns;
    check_times(time_s, points.shape(0));
    made.returns.points.assign(points.data(), points.data() + 3 * points.shape(0));
    made.returns.time_s.assign(time_s.data(), time_s.data() + points.shape(0));
  }
  return made;
}

inline SearchedQuery query_of(const std::vector<Viewed>& scans, const Scanned& dense, const Scanned& sparse, std::size_t spots) {
  require(!scans.empty(), "a query has no scan");
  SearchedQuery query{{}, surface_of(dense), surface_of(sparse), spots};
  require((query.dense.at.times() == nullptr) == (query.sparse.at.times() == nullptr), "either all points have times, or none");
  for (const Viewed& one : scans) query.scans.push_back(scan_of(one));
  return query;
}

template <std::size_t N>
Doubles copy_of(const std::array<double, N>& numbers, std::initializer_list<std::size_t> shape) {
  return array_of(std::vector<std::array<double, N>>{numbers}, shape);
}

inline std::vector<Found> found_in(const RegisteredPoses& poses) {
  std::vector<Found> made;
  for (const RegisteredPose& one : poses) {
    const Registration& placed = one.registration;
    const Fit& fit = one.fit;
    std::optional<Doubles> twist;
    if (placed.twist) twist = copy_of(*placed.twist, {6});
    std::optional<double> seen_free;
    if (!std::isnan(fit.seen_free)) seen_free = fit.seen_free;
    made.emplace_back(one.template_row, one.start_z_m, copy_of(placed.T_level_sensor, {4, 4}), placed.inlier_ratio,
                      placed.alignment_score, copy_of(placed.information, {6, 6}), placed.rests, std::move(twist),
                      fit.free_space_violation, fit.removed_surface, seen_free, fit.beside_surface, fit.same_plane, one.is_alike,
                      fit.alignment_score, one.support);
  }
  return made;
}

}  // namespace firstfix::python
