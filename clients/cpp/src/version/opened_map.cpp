#include "opened_map.hpp"

#include <cstddef>
#include <limits>

namespace firstfix::version {
namespace {

PlacesOptions places_options(const LocalizeOptions& options) {
  PlacesOptions made{options.gravity, options.prior, options.T_base_sensor, std::nullopt};
  if (options.max_candidates) made.max_places = static_cast<std::size_t>(*options.max_candidates);
  return made;
}

}  // namespace

OpenedMap::OpenedMap(std::string named, const VersionFolder& folder)
    : id(std::move(named)),
      version(folder.version()),
      templates(folder),
      tables(folder, templates.places().count),
      calibrations(version::calibrations(folder.file("calibration.json"))),
      bound(folder),
      usual_height_m(templates.usual_height_m()) {}

SearchedMap OpenedMap::searched(const LocalizeOptions& options) const {
  const EngineNumbers& n = templates.numbers;
  std::optional<double> radius_m;
  if (options.prior && !options.max_false_accept) radius_m = options.prior->radius_m;
  SearchedMap map{};
  map.fine = tables.fine, map.coarse = tables.coarse, map.near = tables.near, map.far = tables.far, map.seen_free = tables.seen_free;
  map.places = templates.places(), map.alias_table = tables.alias_table;
  map.reach_m = n.reach_m, map.spacing_m = n.spacing_m, map.compared = n.compared, map.effort = n.effort;
  map.usual_height_m = usual_height_m, map.default_height_m = n.default_height_m;
  map.registration = n.registration, map.nearby = n.nearby, map.aliases = n.aliases, map.ranking = n.ranking;
  map.calibration = calibrations.judging(radius_m);
  return map;
}

double OpenedMap::asked(const LocalizeOptions& options) const {
  if (options.max_false_accept) return bound.min_probability(*options.max_false_accept, id);
  return options.min_probability.value_or(std::numeric_limits<double>::quiet_NaN());
}

MapQuery::MapQuery(const OpenedMap& opened, std::vector<PlacedScan>&& scans, const LocalizeOptions& options, const Deadline& deadline)
    : opened_(opened),
      asked_(opened.asked(options)),
      map_(opened.searched(options)),
      search_(opened.templates, map_, std::move(scans), places_options(options), asked_, deadline) {}

std::vector<PlacedScan> prepared(const AskedScans& scans, const LocalizeOptions& options, const OpenedMap& map) {
  return prepared(scans, places_options(options), map.templates.numbers, options.twist);
}

}  // namespace firstfix::version
