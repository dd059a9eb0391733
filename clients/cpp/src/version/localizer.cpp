#include "firstfix/version/localizer.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "asked_scan.hpp"
#include "checked_options.hpp"
#include "diagnosis.hpp"
#include "firstfix/query/verdict.hpp"
#include "firstfix/registration/covariance.hpp"
#include "opened_map.hpp"
#include "poses.hpp"

namespace firstfix {
namespace {

using version::MapQuery;
using version::OpenedMap;
using MapQueries = std::vector<std::unique_ptr<MapQuery>>;

const char* reason_of(Why why) {
  switch (why) {
    case Why::kNoCandidate: return "no_candidate";
    case Why::kLowInlierRatio: return "low_inlier_ratio";
    case Why::kFreeSpaceViolation: return "free_space_violation";
    case Why::kNotConverged: return "not_converged";
    case Why::kSeveralPlaces: return "several_places";
    default: return "low_probability";
  }
}

Twist twist_of(const Vector6& motion) { return {{motion[0], motion[1], motion[2]}, {motion[3], motion[4], motion[5]}}; }

// A pose that competes, in one of the maps.
struct FoundPlace {
  std::size_t map;  // number of its query
  const RegisteredPose* pose;
};

Hypothesis hypothesis_of(const RegisteredPose& one, double probability, const OpenedMap& map) {
  AlignmentQuality quality{one.fit.inlier_ratio, one.fit.alignment_score, one.fit.free_space_violation, one.fit.removed_surface, {}};
  if (!std::isnan(one.fit.seen_free)) quality.seen_free = one.fit.seen_free;
  const PoseMatrix T_map_sensor = version::product(map.templates.numbers.T_map_level, one.registration.T_level_sensor);
  return {version::pose_of(T_map_sensor), quality, probability, one.template_row, map.id};
}

// What only a pose has: its covariance, and what follows from it.
void place(Localization& answer, const RegisteredPose& best, const MapQuery& query, const LocalizeOptions& options) {
  const PoseMatrix& T_map_level = query.of().templates.numbers.T_map_level;
  const Registration& placed = best.registration;
  const PoseMatrix T_map_sensor = version::product(T_map_level, placed.T_level_sensor);
  answer.T_map_sensor = version::pose_of(T_map_sensor);
  if (options.T_base_sensor) {
    answer.T_map_base = version::pose_of(version::product(T_map_sensor, version::inverse(version::matrix_of(*options.T_base_sensor))));
  }
  const ScannedSurface& dense = query.search().dense();
  const SearchedMap& map = query.map();
  const ScannedSurface seen = placed.twist && dense.at.times() != nullptr ? deskewed(dense, *placed.twist) : dense;
  const Matrix6 information = faced_information(map.fine, {seen.at.points.data(), seen.size()}, placed.T_level_sensor,
                                                placed.information, static_cast<float>(map.registration.fine_distance_m));
  answer.covariance = pose_covariance(information, T_map_level, map.registration.map_voxel_m);
  for (const FreeAxis& one : free_axes(*answer.covariance)) {
    answer.degenerate.push_back({one.is_turn, one.direction, one.sigma});
  }
  if (options.twist) answer.twist = options.twist;
  else if (placed.twist) answer.twist = twist_of(*placed.twist);
}

// Distinct poses of all maps, best first.
std::vector<FoundPlace> places_of(const MapQueries& queries) {
  std::vector<FoundPlace> places;
  for (std::size_t map = 0; map < queries.size(); ++map) {
    for (const RegisteredPose& one : queries[map]->search().found()) places.push_back({map, &one});
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const FoundPlace& one, const FoundPlace& other) { return has_more_support(*one.pose, *other.pose); });
  return places;
}

Decision decided(const MapQueries& queries, const std::vector<FoundPlace>& places) {
  std::vector<JudgingMap> judging;
  for (const auto& query : queries) judging.push_back({query->map().ranking, query->map().calibration});
  std::vector<Competitor> ranked;
  for (const FoundPlace& one : places) {
    const version::ScanSearch& search = queries[one.map]->search();
    const Registration& placed = one.pose->registration;
    const double outside_lead = one.pose == &search.found().front() ? search.outside_lead() : 0;
    ranked.push_back({one.map, one.pose->fit, one.pose->support, search.spots(), one.pose->is_alike, outside_lead, placed.rests,
                      is_in_motion(placed)});
  }
  const double asked = places.empty() ? std::numeric_limits<double>::quiet_NaN() : queries[places.front().map]->asked();
  return Judge(judging, ranked).decided(asked);
}

// The answer without what follows from its scan's points.
Localization judged(const MapQueries& queries, const std::vector<FoundPlace>& places, const LocalizeOptions& options) {
  Localization answer;
  const Decision decision = decided(queries, places);
  answer.probability = decision.probability;
  for (std::size_t i = 0; i < places.size(); ++i) {
    answer.hypotheses.push_back(hypothesis_of(*places[i].pose, decision.shares[i], queries[places[i].map]->of()));
  }
  if (decision.why == Why::kLocalized) {
    answer.verdict = Verdict::localized;
    place(answer, *places.front().pose, *queries[places.front().map], options);
  } else {
    answer.verdict = decision.why == Why::kSeveralPlaces ? Verdict::ambiguous : Verdict::rejected;
    answer.reasons = {reason_of(decision.why)};
  }
  return answer;
}

}  // namespace

struct Localizer::Opened {
  Opened(const std::vector<MapFolder>& folders, double explaining_share) : explaining(explaining_share) {
    constexpr std::size_t kMostMaps = 16;
    std::set<std::string> ids;
    for (const MapFolder& one : folders) ids.insert(one.map_id);
    if (folders.empty() || folders.size() > kMostMaps || ids.size() < folders.size()) {
      throw Error("invalid_option", "a localizer has 1 to 16 maps of different ids, not " + std::to_string(folders.size()));
    }
    for (const MapFolder& one : folders) maps.push_back(std::make_unique<OpenedMap>(one.map_id, version::VersionFolder(one.folder)));
  }

  // options: checked.
  Localization localized(const version::AskedScans& scans, const LocalizeOptions& options) const {
    const auto began = Deadline::Clock::now();
    if (maps.size() > 1 && (options.prior || options.version)) throw Error("invalid_option", "a prior and a version belong to one map: name it");
    Deadline deadline;
    if (options.deadline_ms) deadline = Deadline::after_s(*options.deadline_ms / 1000, began);
    MapQueries queries;
    for (const auto& map : maps) {
      map->asked(options);  // it may refuse the option
      auto prepared = version::prepared(scans, options, *map);
      if (!prepared.empty()) queries.push_back(std::make_unique<MapQuery>(*map, std::move(prepared), options, deadline));
    }
    std::vector<version::ScanSearch*> searches;
    for (const auto& query : queries) searches.push_back(&query->search());
    if (!searches.empty()) version::search_all(searches);
    const std::vector<FoundPlace> places = places_of(queries);
    Localization answer;
    if (queries.empty()) answer.reasons = {"too_few_points"};
    else answer = judged(queries, places, options);
    const MapQuery* const best = queries.empty() ? nullptr : queries[places.empty() ? 0 : places.front().map].get();
    const OpenedMap& of = best == nullptr ? *maps.front() : best->of();
    version::diagnose(answer, {scans, options, of, best, began, deadline, explaining});
    answer.map_id = of.id, answer.map_version = of.version;
    return answer;
  }

  std::vector<std::unique_ptr<const OpenedMap>> maps;
  double explaining;
};

Localizer::Localizer(const std::string& folder, double explaining) : Localizer(std::vector<MapFolder>{{"", folder}}, explaining) {}
Localizer::Localizer(const std::vector<MapFolder>& maps, double explaining) : opened_(std::make_unique<Opened>(maps, explaining)) {}
Localizer::~Localizer() = default;
Localizer::Localizer(Localizer&&) noexcept = default;
Localizer& Localizer::operator=(Localizer&&) noexcept = default;

const std::string& Localizer::version() const { return opened_->maps.front()->version; }

Localization Localizer::localize(const Scan& scan, const LocalizeOptions& options) const {
  return opened_->localized(version::asked(scan), version::checked(options));
}

Localization Localizer::localize(const CompactScan& scan, const LocalizeOptions& options) const {
  return opened_->localized(version::asked(scan), version::checked(options));
}

Localization Localizer::localize(const ScanSequence& sequence, const LocalizeOptions& options) const {
  return opened_->localized(version::asked(sequence), version::checked(options));
}

}  // namespace firstfix
