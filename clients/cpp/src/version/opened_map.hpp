// A version of a map, opened, and its part of a query.
#pragma once

#include <optional>
#include <string>

#include "false_accept_bound.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/query/map_search.hpp"
#include "firstfix/query/prepared_query.hpp"
#include "map_tables.hpp"
#include "ranking_numbers.hpp"
#include "sent_query.hpp"
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
  // options: checked. opened: must outlive it.
  MapQuery(const OpenedMap& opened, PreparedQuery&& prepared, const LocalizeOptions& options, const Deadline& deadline);
  MapQuery(const MapQuery&) = delete;
  MapQuery& operator=(const MapQuery&) = delete;

  const OpenedMap& of() const { return opened_; }
  const PreparedQuery& prepared() const { return prepared_; }
  MapSearch& search() { return search_; }
  const MapSearch& search() const { return search_; }

 private:
  const OpenedMap& opened_;
  SearchedMap map_;
  PreparedQuery prepared_;
  MapSearch search_;  // refers to the two above
};

// The query of the scans as a map needs them; nothing if none has enough points.
std::optional<PreparedQuery> prepared(const SentScans& scans, const LocalizeOptions& options, const OpenedMap& map);

}  // namespace firstfix::version
