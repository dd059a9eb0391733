#include "firstfix/version/pose_search.hpp"

#include <cmath>
#include <utility>

#include "asked_scan.hpp"
#include "firstfix/query/search.hpp"
#include "map_tables.hpp"
#include "poses.hpp"
#include "ranking_numbers.hpp"
#include "template_tables.hpp"
#include "version_folder.hpp"

namespace firstfix {
namespace {

// Tells which poses lie within a prior.
Allows allowed_by(const std::optional<Prior>& prior, const PoseMatrix& T_map_level) {
  if (!prior) return {};
  return [within = *prior, T_map_level, headings = HeadingPrior{T_map_level, prior->yaw_deg, prior->yaw_range_deg}](
             const std::vector<PoseMatrix>& T_level_sensor) {
    std::vector<std::uint8_t> allowed;
    for (const PoseMatrix& T : T_level_sensor) {
      const PoseMatrix T_map_sensor = version::product(T_map_level, T);
      double away2 = 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double away = T_map_sensor[4 * axis + 3] - within.position[axis];
        away2 += away * away;
      }
      allowed.push_back(std::sqrt(away2) <= within.radius_m && headings.allows(T) ? 1 : 0);
    }
    return allowed;
  };
}

SearchedQuery query_of(PreparedScan&& prepared) {
  SearchedQuery made;
  ViewedScan viewed{version::kSameFrame, std::move(prepared.view), {}};
  if (prepared.viewed.times() != nullptr) viewed.returns = std::move(prepared.viewed);
  made.scans.push_back(std::move(viewed));
  made.sparse = prepared.sparse.size() > 0 ? std::move(prepared.sparse) : prepared.dense;
  made.dense = std::move(prepared.dense);
  return made;
}

}  // namespace

struct PoseSearch::Opened {
  explicit Opened(const version::VersionFolder& folder)
      : version(folder.version()), templates(folder), tables(folder), calibrations(version::calibrations(folder.file("calibration.json"))) {}

  // The map as queries of these options search it.
  SearchedMap searched(const PlacesOptions& options) const {
    const version::EngineNumbers& n = templates.numbers;
    std::optional<double> radius_m;
    if (options.prior) radius_m = options.prior->radius_m;
    return {tables.fine, tables.coarse, tables.near, tables.far, tables.seen_free,
            n.reach_m,   n.registration, n.nearby,    n.aliases,  n.ranking, calibrations.judging(radius_m), n.compared};
  }

  std::string version;
  version::TemplateTables templates;
  version::MapTables tables;
  version::Calibrations calibrations;
};

PoseSearch::PoseSearch(const std::string& folder) : opened_(std::make_unique<Opened>(version::VersionFolder(folder))) {}
PoseSearch::~PoseSearch() = default;
PoseSearch::PoseSearch(PoseSearch&&) noexcept = default;
PoseSearch& PoseSearch::operator=(PoseSearch&&) noexcept = default;

const std::string& PoseSearch::version() const { return opened_->version; }

std::vector<RankedPose> PoseSearch::find(const Scan& scan, const PlacesOptions& options) const {
  const version::EngineNumbers& numbers = opened_->templates.numbers;
  auto prepared = version::prepared(scan, options, numbers);
  if (!prepared) return {};
  const Candidates found = opened_->templates.candidates(*prepared, options.prior, options.max_places.value_or(numbers.candidates));
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < found.templates.size(); ++i) {
    candidates.push_back({found.templates[i], found.T_level_sensor[i], static_cast<double>(found.score[i])});
  }
  const SearchedMap map = opened_->searched(options);
  const SearchedQuery query = query_of(std::move(*prepared));
  Search search(map, query, allowed_by(options.prior, numbers.T_map_level));
  search.run(candidates, std::nullopt, {});
  if (numbers.searches_beside) search.search_near();
  std::vector<RankedPose> poses;
  for (const RegisteredPose& one : search.found()) {
    const Registration& placed = one.registration;
    poses.push_back({version::product(numbers.T_map_level, placed.T_level_sensor), one.support, one.fit, placed.rests, one.template_row});
  }
  return poses;
}

}  // namespace firstfix
