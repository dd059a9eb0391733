// The answer of a query: which of the places that were found is right, how surely, and how exactly its pose is known.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/query/climb.hpp"
#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/map_search.hpp"
#include "firstfix/query/motion_at_places.hpp"
#include "firstfix/query/verdict.hpp"
#include "firstfix/registration/covariance.hpp"

namespace firstfix {

// One of the places that compete. It refers to its search.
struct AnsweredPlace {
  std::size_t search;  // which one: that of its map
  const RegisteredPose* pose;
  PoseMatrix T_map_sensor;
  double share;  // probability that it is the right one
};

// What only a localized query has.
struct AnsweredPose {
  std::optional<PoseMatrix> T_map_base;
  Matrix6 covariance;
  std::vector<FreeAxis> degenerate;
};

struct Answered {
  Decision decision;
  std::vector<AnsweredPlace> places;  // of all maps, best first
  std::optional<AnsweredPose> pose;   // at the first place
};

namespace detail {

inline AnsweredPose pose_at(const Registration& placed, const MapSearch& search, const PoseMatrix& T_map_sensor,
                            const std::optional<PoseMatrix>& T_base_sensor) {
  const SearchedMap& map = search.map();
  const ScannedSurface& dense = search.query().dense;
  const bool is_moved = placed.twist && dense.at.times() != nullptr;
  const ScannedSurface still = is_moved ? deskewed(dense, *placed.twist) : ScannedSurface{};
  const Matrix6 information = faced_information(map.fine, points_of(is_moved ? still : dense), placed.T_level_sensor,
                                                placed.information, static_cast<float>(map.registration.fine_distance_m));
  AnsweredPose made{std::nullopt, pose_covariance(information, map.T_map_level, map.registration.map_voxel_m), {}};
  if (T_base_sensor) made.T_map_base = product(T_map_sensor, inverse(*T_base_sensor));
  made.degenerate = free_axes(made.covariance);
  return made;
}

}  // namespace detail

// Judges what searches have found, each in a map of its own. The best place's search gives the threshold.
inline Answered judged(const std::vector<MapSearch*>& searches, const std::optional<PoseMatrix>& T_base_sensor) {
  Answered answer;
  std::vector<JudgingMap> maps;
  for (std::size_t number = 0; number < searches.size(); ++number) {
    const SearchedMap& map = searches[number]->map();
    maps.push_back({map.ranking, map.calibration});
    for (const RegisteredPose& one : searches[number]->found()) {
      answer.places.push_back({number, &one, detail::product(map.T_map_level, one.registration.T_level_sensor), 0});
    }
  }
  std::stable_sort(answer.places.begin(), answer.places.end(), [](const AnsweredPlace& one, const AnsweredPlace& other) {
    return one.pose->support > other.pose->support;
  });
  std::vector<Competitor> ranked;
  for (const AnsweredPlace& one : answer.places) {
    const MapSearch& search = *searches[one.search];
    const Registration& placed = one.pose->registration;
    const bool is_first = one.pose == &search.found().front();
    ranked.push_back({one.search, one.pose->fit, one.pose->support, search.query().spots, one.pose->is_alike,
                      is_first ? search.outside_lead() : 0, placed.rests, is_in_motion(placed)});
  }
  const MapSearch* const best = ranked.empty() ? nullptr : searches[ranked.front().map];
  answer.decision = Judge(maps, ranked).decided(best == nullptr ? std::numeric_limits<double>::quiet_NaN() : best->options().asked);
  for (std::size_t i = 0; i < ranked.size(); ++i) answer.places[i].share = answer.decision.shares[i];
  if (answer.decision.why == Why::kLocalized) {
    const AnsweredPlace& first = answer.places.front();
    answer.pose = detail::pose_at(first.pose->registration, *best, first.T_map_sensor, T_base_sensor);
  }
  return answer;
}

// Searches all maps and judges what was found: the whole way of a prepared query. is_one_likely: as of search_maps.
inline Answered answered(const std::vector<MapSearch*>& searches, bool is_one_likely, const std::optional<PoseMatrix>& T_base_sensor,
                         StageTimes& times) {
  search_maps(searches, is_one_likely, times);
  return times.of("verify", [&] { return judged(searches, T_base_sensor); });
}

}  // namespace firstfix
