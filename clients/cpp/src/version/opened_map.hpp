// A version of a map, opened, and its part of a query.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "asked_scan.hpp"
#include "false_accept_bound.hpp"
#include "firstfix/answer/options.hpp"
#include "map_tables.hpp"
#include "ranking_numbers.hpp"
#include "scan_search.hpp"
#include "template_tables.hpp"
#include "version_folder.hpp"

namespace firstfix::version {

struct OpenedMap {
  // id: by which answers name it. Throws as the constructor of Localizer.
  OpenedMap(std::string id, const VersionFolder& folder);

  // The map as queries of these options search it.
  SearchedMap searched(const LocalizeOptions& options) const;

  // The threshold on the probability that the caller asks for; not a number: none. Throws Error "invalid_option" if the map cannot keep
  // max_false_accept.
  double asked(const LocalizeOptions& options) const;

  std::string id, version;
  TemplateTables templates;
  MapTables tables;
  Calibrations calibrations;
  FalseAcceptBound bound;
  double usual_height_m;
};

// What a query is in one map: its scans, prepared for it, and their search.
class MapQuery {
 public:
  // options: checked. opened, what the scans refer to: must outlive it.
  MapQuery(const OpenedMap& opened, std::vector<PlacedScan>&& scans, const LocalizeOptions& options, const Deadline& deadline);
  MapQuery(const MapQuery&) = delete;
  MapQuery& operator=(const MapQuery&) = delete;

  const OpenedMap& of() const { return opened_; }
  const SearchedMap& map() const { return map_; }
  double asked() const { return asked_; }
  ScanSearch& search() { return search_; }
  const ScanSearch& search() const { return search_; }

 private:
  const OpenedMap& opened_;
  double asked_;
  SearchedMap map_;
  ScanSearch search_;
};

// The scans as a map needs them; none have enough points: empty.
std::vector<PlacedScan> prepared(const AskedScans& scans, const LocalizeOptions& options, const OpenedMap& map);

}  // namespace firstfix::version
