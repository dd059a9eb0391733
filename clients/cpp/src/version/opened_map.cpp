#include "opened_map.hpp"

#include <cstddef>
#include <limits>
#include <utility>

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
  map.T_map_level = n.T_map_level;
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

MapQuery::MapQuery(const OpenedMap& opened, PreparedQuery&& prepared, const LocalizeOptions& options, const Deadline& deadline)
    : opened_(opened),
      map_(opened.searched(options)),
      prepared_(std::move(prepared)),
      search_(map_, prepared_.searched(), prepared_.queried(&opened.templates.numbers.grid), opened.templates.describe(),
              {region_of(options.prior, map_.T_map_level), prepared_.sensor().gravity, prepared_.sensor().up_by_mounting,
               places_options(options).max_places, opened.asked(options), deadline}) {}

std::optional<PreparedQuery> prepared(const SentScans& scans, const LocalizeOptions& options, const OpenedMap& map) {
  return prepared(scans, places_options(options), map.templates.numbers, options.twist);
}

}  // namespace firstfix::version
