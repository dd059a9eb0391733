// Search of a query in a version: its scans and their search, kept together.
#pragma once

#include <cstddef>
#include <vector>

#include "asked_scan.hpp"
#include "firstfix/query/climb.hpp"
#include "firstfix/version/places_options.hpp"
#include "template_tables.hpp"

namespace firstfix::version {

class ScanSearch {
 public:
  // templates, map, what the scans refer to: must outlive it. asked: the threshold on the probability that the caller asks for; not
  // a number: none.
  ScanSearch(const TemplateTables& templates, const SearchedMap& map, std::vector<PlacedScan>&& scans, const PlacesOptions& options,
             double asked, const Deadline& deadline);
  ScanSearch(const ScanSearch&) = delete;
  ScanSearch& operator=(const ScanSearch&) = delete;

  // Takes the first step alone, and returns true; false, if no more than a share of the scan lies on the map: no step is taken then.
  bool look(double inlier_ratio);

  const RegisteredPoses& found() const { return search_.found(); }
  bool is_settled() const { return search_.is_settled(); }
  double outside_lead() const { return search_.outside_lead(); }

  const std::vector<PlacedScan>& scans() const { return scans_; }

  // All points of the scans, one a voxel, and how many spots they are of.
  const ScannedSurface& dense() const { return query_.dense; }
  std::size_t spots() const { return query_.spots; }

  // Climbs the ladder of effort, in one map or several.
  friend void search_all(const std::vector<ScanSearch*>& searches);

 private:
  std::vector<PlacedScan> scans_;
  SearchedQuery query_;
  MapSearch search_;  // refers to the two above
};

void search_all(const std::vector<ScanSearch*>& searches);

}  // namespace firstfix::version
