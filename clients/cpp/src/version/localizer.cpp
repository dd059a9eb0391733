#include "firstfix/version/localizer.hpp"

#include <cmath>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "checked_options.hpp"
#include "diagnosis.hpp"
#include "firstfix/query/answered.hpp"
#include "opened_map.hpp"
#include "poses.hpp"
#include "sent_query.hpp"

namespace firstfix {
namespace {

using version::MapQuery;
using version::OpenedMap;
using MapQueries = std::vector<std::unique_ptr<MapQuery>>;

Twist twist_of(const Vector6& motion) { return {{motion[0], motion[1], motion[2]}, {motion[3], motion[4], motion[5]}}; }

Hypothesis hypothesis_of(const AnsweredPlace& place, const OpenedMap& map) {
  const RegisteredPose& one = *place.pose;
  AlignmentQuality quality{one.fit.inlier_ratio, one.fit.alignment_score, one.fit.free_space_violation, one.fit.removed_surface, {}};
  if (!std::isnan(one.fit.seen_free)) quality.seen_free = one.fit.seen_free;
  return {version::pose_of(place.T_map_sensor), quality, place.share, one.template_row, map.id};
}

// What only a localized answer has.
void take_pose(Localization& answer, const AnsweredPlace& first, const AnsweredPose& pose, const LocalizeOptions& options) {
  answer.verdict = Verdict::localized;
  answer.T_map_sensor = version::pose_of(first.T_map_sensor);
  if (pose.T_map_base) answer.T_map_base = version::pose_of(*pose.T_map_base);
  answer.covariance = pose.covariance;
  for (const FreeAxis& one : pose.degenerate) answer.degenerate.push_back({one.is_turn, one.direction, one.sigma});
  const KnownTwist& solved = first.pose->registration.twist;
  if (options.twist) answer.twist = options.twist;
  else if (solved) answer.twist = twist_of(*solved);
}

// The answer without what follows from its scan's points.
Localization localization_of(const Answered& found, const MapQueries& queries, const LocalizeOptions& options) {
  Localization answer;
  answer.probability = found.decision.probability;
  for (const AnsweredPlace& one : found.places) answer.hypotheses.push_back(hypothesis_of(one, queries[one.search]->of()));
  if (const auto reason = code_of(found.decision.why)) {
    answer.verdict = found.decision.why == Why::kSeveralPlaces ? Verdict::ambiguous : Verdict::rejected;
    answer.reasons = {*reason};
  } else {
    take_pose(answer, found.places.front(), *found.pose, options);
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
  Localization localized(const version::SentScans& scans, const LocalizeOptions& options, const Cancellation& cancellation) const {
    const auto began = Deadline::Clock::now();
    if (maps.size() > 1 && (options.prior || options.version)) throw Error("invalid_option", "a prior and a version belong to one map: name it");
    Deadline deadline;
    if (options.deadline_ms) deadline = Deadline::after_s(*options.deadline_ms / 1000, began);
    deadline = deadline.unless(cancellation);
    MapQueries queries;
    std::vector<MapSearch*> searches;
    for (const auto& map : maps) {
      deadline.check_wanted();
      map->asked(options);  // it may refuse the option
      auto prepared = version::prepared(scans, options, *map);
      if (!prepared) continue;
      queries.push_back(std::make_unique<MapQuery>(*map, std::move(*prepared), options, deadline));
      searches.push_back(&queries.back()->search());
    }
    Localization answer;
    const MapQuery* best = queries.empty() ? nullptr : queries.front().get();
    if (queries.empty()) {
      answer.reasons = {"too_few_points"};
    } else {
      std::optional<PoseMatrix> mounting;
      if (options.T_base_sensor) mounting = version::matrix_of(*options.T_base_sensor);
      StageTimes times;
      const Answered found = answered(searches, false, mounting, times);
      answer = localization_of(found, queries, options);
      if (!found.places.empty()) best = queries[found.places.front().search].get();
    }
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

Localization Localizer::localize(const Scan& scan, const LocalizeOptions& options, const Cancellation& cancellation) const {
  return opened_->localized(version::sent(scan), version::checked(options), cancellation);
}

Localization Localizer::localize(const CompactScan& scan, const LocalizeOptions& options, const Cancellation& cancellation) const {
  return opened_->localized(version::sent(scan), version::checked(options), cancellation);
}

Localization Localizer::localize(const ScanSequence& sequence, const LocalizeOptions& options, const Cancellation& cancellation) const {
  return opened_->localized(version::sent(sequence), version::checked(options), cancellation);
}

}  // namespace firstfix
