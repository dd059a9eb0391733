// Search of one scan in a version: the scan and its search, kept together.
#pragma once

#include "firstfix/query/climb.hpp"
#include "firstfix/version/places_options.hpp"
#include "template_tables.hpp"

namespace firstfix::version {

class ScanSearch {
 public:
  // templates, map: must outlive it. asked: the threshold on the probability that the caller asks for; not a number: none.
  ScanSearch(const TemplateTables& templates, const SearchedMap& map, PreparedScan&& scan, const PlacesOptions& options, double asked,
             const Deadline& deadline);
  ScanSearch(const ScanSearch&) = delete;
  ScanSearch& operator=(const ScanSearch&) = delete;

  // Climbs the ladder of effort.
  void run();

  const RegisteredPoses& found() const { return search_.found(); }
  double outside_lead() const { return search_.outside_lead(); }

  // All points of the scan, one a voxel.
  const ScannedSurface& dense() const { return query_.dense; }

 private:
  QueriedScan scan_;  // refers to the two below
  std::vector<float> seen_;
  SearchedQuery query_;
  MapSearch search_;
};

}  // namespace firstfix::version
