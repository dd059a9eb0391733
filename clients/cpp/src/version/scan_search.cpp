#include "scan_search.hpp"

#include <utility>

#include "asked_scan.hpp"
#include "poses.hpp"

namespace firstfix::version {
namespace {

SearchedQuery query_of(PreparedScan&& prepared) {
  SearchedQuery made;
  ViewedScan viewed{kSameFrame, std::move(prepared.view), {}};
  if (prepared.viewed.times() != nullptr) viewed.returns = std::move(prepared.viewed);
  made.scans.push_back(std::move(viewed));
  made.sparse = prepared.sparse.size() > 0 ? std::move(prepared.sparse) : prepared.dense;
  made.dense = std::move(prepared.dense);
  return made;
}

}  // namespace

// The vectors that `queried` refers to are moved, which leaves their numbers where they are.
ScanSearch::ScanSearch(const TemplateTables& templates, const SearchedMap& map, PreparedScan&& scan, const PlacesOptions& options,
                       double asked, const Deadline& deadline)
    : scan_(queried(scan)),
      seen_(std::move(scan.seen)),
      query_(query_of(std::move(scan))),
      search_(map, query_, {scan_}, templates.describe(),
              {region_of(options.prior, templates.numbers.T_map_level), options.gravity, up_by_mounting(options.T_base_sensor),
               options.max_places, asked, deadline}) {}

void ScanSearch::run() {
  StageTimes times;
  search_maps({&search_}, false, times);
}

}  // namespace firstfix::version
