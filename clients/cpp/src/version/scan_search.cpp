#include "scan_search.hpp"

#include <utility>

#include "firstfix/query/joined_scans.hpp"
#include "poses.hpp"

namespace firstfix::version {
namespace {

SearchedQuery query_of(const std::vector<PlacedScan>& scans, const EngineNumbers& numbers) {
  SearchedQuery made;
  std::vector<PoseMatrix> poses;
  for (const PlacedScan& one : scans) {
    const bool is_timed = one.prepared.viewed.times() != nullptr;
    made.scans.push_back({one.T_last_scan, one.prepared.view, is_timed ? one.prepared.viewed : PointsInTime{}});
    poses.push_back(one.T_last_scan);
  }
  made.spots = spots_of(poses, numbers.spots_apart_m);
  const PreparedScan& first = scans.front().prepared;
  if (scans.size() == 1 && poses.front() == kSameFrame) {
    made.dense = first.dense, made.sparse = first.sparse.size() > 0 ? first.sparse : first.dense;
    return made;
  }
  std::vector<PlacedSurface> parts;
  for (const PlacedScan& one : scans) parts.push_back({one.T_last_scan, &one.prepared.dense});
  const Preparation& wanted = numbers.preparation;
  JoinedSurface together = joined(parts, wanted.voxel_m, wanted.dense_points, wanted.sparse_points);
  made.dense = std::move(together.dense), made.sparse = std::move(together.sparse);
  return made;
}

std::vector<QueriedScan> queried(const std::vector<PlacedScan>& scans) {
  std::vector<QueriedScan> made;
  for (const PlacedScan& one : scans) made.push_back(queried(one));
  return made;
}

}  // namespace

ScanSearch::ScanSearch(const TemplateTables& templates, const SearchedMap& map, std::vector<PlacedScan>&& scans,
                       const PlacesOptions& options, double asked, const Deadline& deadline)
    : scans_(std::move(scans)),
      query_(query_of(scans_, templates.numbers)),
      search_(map, query_, queried(scans_), templates.describe(),
              {region_of(options.prior, templates.numbers.T_map_level), options.gravity, up_by_mounting(options.T_base_sensor),
               options.max_places, asked, deadline}) {}

bool ScanSearch::look(double inlier_ratio) {
  StageTimes times;
  if (!search_.may_fit(inlier_ratio, times)) return false;
  search_.take(Step::narrow, times);
  return true;
}

void search_all(const std::vector<ScanSearch*>& searches) {
  std::vector<MapSearch*> of_maps;
  for (ScanSearch* const one : searches) of_maps.push_back(&one->search_);
  StageTimes times;
  search_maps(of_maps, false, times);
}

}  // namespace firstfix::version
