// The ladder of effort: which steps a query takes, in one map or several (docs/method.md section 7.1).
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "firstfix/query/map_search.hpp"

namespace firstfix {

namespace detail {

// Whether a search's best place explains the scan. What cannot do so is not ranked for it.
inline bool explains_scan(MapSearch& search, StageTimes& times) {
  if (!search.may_explain_scan(times)) return false;
  search.rank(times);
  return search.explains_scan();
}

// Until a place explains the scan: most scans need the first step alone.
inline void climb(const std::vector<MapSearch*>& searches, StageTimes& times) {
  for (MapSearch* const search : searches) {
    search->take(Step::narrow, times);
    search->rank(times);
    if (!search->is_settled()) search->take(Step::wide, times);
  }
  const auto explains = [&](MapSearch* search) { return explains_scan(*search, times); };
  for (const Step step : {Step::other_ups, Step::exhaustive}) {
    if (std::any_of(searches.begin(), searches.end(), explains)) break;
    for (MapSearch* const search : searches) search->take(step, times);
  }
  for (MapSearch* const search : searches) search->rank(times);
}

// Probes all maps, and takes the first step in the best one. Returns whether its place is accepted. The places of the others
// compete with it in the answer.
inline bool one_explains_scan(const std::vector<MapSearch*>& searches, StageTimes& times) {
  constexpr std::size_t kProbed = 24;            // templates that are registered, of all maps together
  constexpr std::size_t kLeastProbedPerMap = 3;  // of each
  MapSearch* best = nullptr;
  for (MapSearch* const search : searches) {
    search->probe(std::max(kLeastProbedPerMap, kProbed / searches.size()), times);
    const bool is_better = !search->found().empty() &&
                           (best == nullptr || search->found().front().support > best->found().front().support);
    if (is_better) best = search;
  }
  if (best == nullptr) return false;
  best->take(Step::narrow, times);
  best->rank(times);
  return best->is_settled();
}

}  // namespace detail

// Searches all maps, whose places then compete, with the known aliases of the best one of each.
//
// is_one_likely: the maps were chosen because each resembles the scan, and at most one of them is right. If one explains the scan
// clearly, the others are only looked at.
inline void search_maps(const std::vector<MapSearch*>& searches, bool is_one_likely, StageTimes& times) {
  if (!(is_one_likely && detail::one_explains_scan(searches, times))) detail::climb(searches, times);
  for (MapSearch* const search : searches) search->try_aliases(times);
}

}  // namespace firstfix
