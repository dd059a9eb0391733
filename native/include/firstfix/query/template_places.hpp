// Where the sensor would stand in other places of a map that look like that of a pose (docs/method.md section 7.1).
//
// A scan's own descriptor may miss the place that it was taken in. Another place that looks the same is then accepted, because
// the right one was never compared with it. The templates around the wrong place know it, or it is right above or below:
// storeys stand on each other, and often by one plan. Descriptors of two such rooms differ by what stands in them, so the
// build may not know them as aliases, and the search may find the one without the other.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <optional>
#include <vector>

#include "firstfix/query/candidate.hpp"
#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/prior.hpp"
#include "firstfix/query/searched_map.hpp"
#include "firstfix/registration/distinct_poses.hpp"

namespace firstfix {

constexpr double kYawSlackDeg = 10.0;  // a candidate's heading is as coarse as the descriptor's sectors
constexpr std::size_t kMostFloors = 4;  // nearest first: of a tower

namespace detail {

inline double away_m(const float* position_m, const PoseMatrix& T) {
  const Vector3 away{static_cast<double>(position_m[0]) - T[3], static_cast<double>(position_m[1]) - T[7],
                     static_cast<double>(position_m[2]) - T[11]};
  return std::sqrt(dot(away, away));
}

// A pose, moved as a point moves to another while it turns about z.
inline PoseMatrix moved(const PoseMatrix& T, const Vector3& start_m, const Vector3& end_m, double yaw_rad) {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  const PoseMatrix move{c, -s, 0, end_m[0] - (c * start_m[0] - s * start_m[1]),
                        s, c,  0, end_m[1] - (s * start_m[0] + c * start_m[1]),
                        0, 0,  1, end_m[2] - start_m[2],
                        0, 0,  0, 1};
  return product(move, T);
}

// Whether a pose is one: a table may hold any number.
inline bool is_within_reach(const PoseMatrix& T) {
  return std::all_of(T.begin(), T.end(), [](double number) { return std::fabs(number) < 1e9; });
}

}  // namespace detail

// A point of the floor below a template.
inline detail::Vector3 floor_m(const TemplatePlaces& places, std::int64_t row) {
  const auto at = static_cast<std::size_t>(row);
  const float* position_m = places.position_m + 3 * at;
  return {static_cast<double>(position_m[0]), static_cast<double>(position_m[1]),
          static_cast<double>(position_m[2]) - static_cast<double>(places.height_m[at])};
}

// A pose moved to the other floors on which the map has templates near by, nearest floor first.
inline std::vector<Candidate> stacked_places(const TemplatePlaces& places, const PoseMatrix& T_level_sensor) {
  const detail::Vector3 at_m{T_level_sensor[3], T_level_sensor[7], T_level_sensor[11]};
  std::vector<std::int64_t> rows = places.tiles.near_on_level(places.position_m, at_m, kStackedWithinM);
  if (rows.empty()) return {};
  const auto position_of = [&](std::int64_t row) { return places.position_m + 3 * static_cast<std::size_t>(row); };
  const std::int64_t nearest = *std::min_element(rows.begin(), rows.end(), [&](std::int64_t one, std::int64_t other) {
    return detail::away_m(position_of(one), T_level_sensor) < detail::away_m(position_of(other), T_level_sensor);
  });
  const double own_m = floor_m(places, nearest)[2];
  const auto on_level_m = [&](std::int64_t row) {
    const double x = static_cast<double>(position_of(row)[0]) - at_m[0], y = static_cast<double>(position_of(row)[1]) - at_m[1];
    return std::sqrt(x * x + y * y);
  };
  std::stable_sort(rows.begin(), rows.end(),
                   [&](std::int64_t one, std::int64_t other) { return on_level_m(one) < on_level_m(other); });
  struct Floor {
    std::int64_t row;
    double up_m;  // from the pose's own
  };
  std::vector<Floor> floors;
  for (const std::int64_t row : rows) {
    const double up_m = floor_m(places, row)[2] - own_m;
    const bool is_other = std::fabs(up_m) > kStoreyM && std::all_of(floors.begin(), floors.end(), [&](const Floor& other) {
                            return std::fabs(other.up_m - up_m) > kStoreyM;
                          });
    if (is_other) floors.push_back({row, up_m});
  }
  std::stable_sort(floors.begin(), floors.end(),
                   [](const Floor& one, const Floor& other) { return std::fabs(one.up_m) < std::fabs(other.up_m); });
  floors.resize(std::min(floors.size(), kMostFloors), Floor{});
  std::vector<Candidate> found;
  for (const Floor& one : floors) {
    found.push_back({one.row, T_level_sensor, 1});
    found.back().T_level_sensor[11] += one.up_m;
  }
  return found;
}

// Poses right above and below a pose, then at aliases of the templates nearest to it, most alike first: those that a prior
// allows. None where the version has no table of aliases.
inline std::vector<Candidate> known_aliases(const SearchedMap& map, const PoseMatrix& T_level_sensor,
                                            const std::optional<PriorRegion>& prior) {
  if (!map.places || !map.alias_table) return {};
  const TemplatePlaces& places = *map.places;
  const detail::Vector3 at_m{T_level_sensor[3], T_level_sensor[7], T_level_sensor[11]};
  std::vector<std::int64_t> near = places.tiles.within(places.position_m, at_m, map.aliases.near_m);
  if (near.empty()) return {};
  std::stable_sort(near.begin(), near.end(), [&](std::int64_t one, std::int64_t other) {
    return detail::away_m(places.position_m + 3 * one, T_level_sensor) <
           detail::away_m(places.position_m + 3 * other, T_level_sensor);
  });
  near.resize(std::min(near.size(), map.aliases.templates));
  std::vector<Candidate> found = stacked_places(places, T_level_sensor);
  for (const TemplateAlias& one : map.alias_table->of(near)) {
    const detail::Vector3 start_m = floor_m(places, one.own), end_m = floor_m(places, one.alias);
    found.push_back({one.alias, detail::moved(T_level_sensor, start_m, end_m, one.yaw_rad), one.score});
  }
  sort_by_score(found);
  const auto is_left_out = [&](const Candidate& one) {
    return !detail::is_within_reach(one.T_level_sensor) ||
           (prior && !prior->allows(one.T_level_sensor, map.spacing_m, kYawSlackDeg));
  };
  found.erase(std::remove_if(found.begin(), found.end(), is_left_out), found.end());
  std::vector<Candidate> kept;
  const double within_rad = radians(map.ranking.same_pose_deg);
  for (const auto row : distinct_poses(poses_of(found), map.ranking.same_pose_m, within_rad, map.aliases.screened)) {
    kept.push_back(found[static_cast<std::size_t>(row)]);
  }
  return kept;
}

}  // namespace firstfix
