#include "firstfix/version/localizer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "asked_scan.hpp"
#include "checked_options.hpp"
#include "false_accept_bound.hpp"
#include "firstfix/query/verdict.hpp"
#include "firstfix/registration/covariance.hpp"
#include "map_tables.hpp"
#include "poses.hpp"
#include "ranking_numbers.hpp"
#include "reason_finding.hpp"
#include "scan_search.hpp"
#include "template_tables.hpp"
#include "version_folder.hpp"

namespace firstfix {
namespace {

PlacesOptions places_options(const LocalizeOptions& options) {
  PlacesOptions made{options.gravity, options.prior, options.T_base_sensor, std::nullopt};
  if (options.max_candidates) made.max_places = static_cast<std::size_t>(*options.max_candidates);
  return made;
}

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

Hypothesis hypothesis_of(const RegisteredPose& one, double probability, const PoseMatrix& T_map_level) {
  AlignmentQuality quality{one.fit.inlier_ratio, one.fit.alignment_score, one.fit.free_space_violation, one.fit.removed_surface, {}};
  if (!std::isnan(one.fit.seen_free)) quality.seen_free = one.fit.seen_free;
  return {version::pose_of(version::product(T_map_level, one.registration.T_level_sensor)), quality, probability, one.template_row, ""};
}

// What only a pose has: its covariance, and what follows from it.
void place(Localization& answer, const RegisteredPose& best, const ScannedSurface& dense, const SearchedMap& map,
           const PoseMatrix& T_map_level, const LocalizeOptions& options) {
  const Registration& placed = best.registration;
  const PoseMatrix T_map_sensor = version::product(T_map_level, placed.T_level_sensor);
  answer.T_map_sensor = version::pose_of(T_map_sensor);
  if (options.T_base_sensor) {
    answer.T_map_base = version::pose_of(version::product(T_map_sensor, version::inverse(version::matrix_of(*options.T_base_sensor))));
  }
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

}  // namespace

struct Localizer::Opened {
  explicit Opened(const version::VersionFolder& folder)
      : version_name(folder.version()),
        templates(folder),
        tables(folder, templates.places().count),
        calibrations(version::calibrations(folder.file("calibration.json"))),
        bound(folder),
        usual_height_m(templates.usual_height_m()) {}

  // The map as queries of these options search it.
  SearchedMap searched(const LocalizeOptions& options) const {
    const version::EngineNumbers& n = templates.numbers;
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

  // options: checked.
  Localization localized(const version::AskedScans& scans, const LocalizeOptions& options) const;

  std::string version_name;
  version::TemplateTables templates;
  version::MapTables tables;
  version::Calibrations calibrations;
  version::FalseAcceptBound bound;
  double usual_height_m;
};

Localizer::Localizer(const std::string& folder) : opened_(std::make_unique<Opened>(version::VersionFolder(folder))) {}
Localizer::~Localizer() = default;
Localizer::Localizer(Localizer&&) noexcept = default;
Localizer& Localizer::operator=(Localizer&&) noexcept = default;

const std::string& Localizer::version() const { return opened_->version_name; }

Localization Localizer::localize(const Scan& scan, const LocalizeOptions& options) const {
  return opened_->localized(version::asked(scan), version::checked(options));
}

Localization Localizer::localize(const CompactScan& scan, const LocalizeOptions& options) const {
  return opened_->localized(version::asked(scan), version::checked(options));
}

Localization Localizer::localize(const ScanSequence& sequence, const LocalizeOptions& options) const {
  return opened_->localized(version::asked(sequence), version::checked(options));
}

Localization Localizer::Opened::localized(const version::AskedScans& scans, const LocalizeOptions& options) const {
  const auto began = Deadline::Clock::now();
  double asked = options.min_probability.value_or(std::numeric_limits<double>::quiet_NaN());
  if (options.max_false_accept) asked = bound.min_probability(*options.max_false_accept);
  Deadline deadline;
  if (options.deadline_ms) deadline = Deadline::after_s(*options.deadline_ms / 1000, began);
  const version::EngineNumbers& numbers = templates.numbers;
  const PlacesOptions places = places_options(options);
  auto prepared = version::prepared(scans, places, numbers, options.twist);
  Localization answer;
  answer.map_version = version_name;
  if (prepared.empty()) {
    answer.reasons = {"too_few_points"};
    return answer;
  }
  const SearchedMap map = searched(options);
  version::ScanSearch search(templates, map, std::move(prepared), places, asked, deadline);
  search.run();
  const RegisteredPoses& found = search.found();
  std::vector<Competitor> ranked;
  for (const RegisteredPose& one : found) {
    const Registration& placed = one.registration;
    const double outside_lead = ranked.empty() ? search.outside_lead() : 0;
    ranked.push_back({0, one.fit, one.support, search.spots(), one.is_alike, outside_lead, placed.rests, is_in_motion(placed)});
  }
  const std::vector<JudgingMap> judging{{map.ranking, map.calibration}};
  const Decision decision = Judge(judging, ranked).decided(asked);
  answer.probability = decision.probability;
  for (std::size_t i = 0; i < found.size(); ++i) answer.hypotheses.push_back(hypothesis_of(found[i], decision.shares[i], numbers.T_map_level));
  if (decision.why == Why::kLocalized) {
    answer.verdict = Verdict::localized;
    place(answer, found.front(), search.dense(), map, numbers.T_map_level, options);
  } else {
    answer.verdict = decision.why == Why::kSeveralPlaces ? Verdict::ambiguous : Verdict::rejected;
    answer.reasons = {reason_of(decision.why)};
    if (const auto why = version::reason_finding(answer)) answer.findings = {*why};
  }
  return answer;
}

}  // namespace firstfix
