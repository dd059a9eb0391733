// Search of one query in one map, step by step of the effort levels (docs/method.md section 7.1).
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/query/deadline.hpp"
#include "firstfix/query/effort.hpp"
#include "firstfix/query/level_hypotheses.hpp"
#include "firstfix/query/promising_templates.hpp"
#include "firstfix/query/search.hpp"
#include "firstfix/query/similar_places.hpp"
#include "firstfix/query/stage_times.hpp"
#include "firstfix/scan/other_ups.hpp"

namespace firstfix {

// What a caller says of a query.
struct SearchOptions {
  std::optional<PriorRegion> prior;
  std::optional<detail::Vector3> gravity;        // in the last scan's frame
  detail::Vector3 up_by_mounting;                // in the same frame; it counts where gravity is not known
  std::optional<std::size_t> max_candidates;     // that are registered
  double asked;                                  // threshold on the probability; not a number: the map's own
  Deadline deadline;
};

// Each step adds to what the steps before it registered. Not thread-safe. The map, the query, and what the scans and the
// description refer to must outlive it. Its calls throw Error "query_cancelled" once the query is cancelled; it is of no use then.
class MapSearch {
 public:
  // scans: of the query, in its order, one or more. map: with places.
  MapSearch(const SearchedMap& map, const SearchedQuery& query, std::vector<QueriedScan> scans, Describe describe,
            const SearchOptions& options)
      : map_(map),
        query_(query),
        scans_(std::move(scans)),
        describe_(std::move(describe)),
        options_(options),
        search_(map, query, options.prior, options.deadline) {}
  MapSearch(const MapSearch&) = delete;
  MapSearch& operator=(const MapSearch&) = delete;

  // Distinct poses, best first, of all steps so far.
  const RegisteredPoses& found() const { return search_.found(); }

  // Support by which a known alias outside the prior is better than the best pose; 0: none is.
  double outside_lead() const { return outside_lead_; }

  const SearchedMap& map() const { return map_; }
  const SearchedQuery& query() const { return query_; }
  const SearchOptions& options() const { return options_; }

  // Steps that were taken, in order.
  const std::vector<Step>& taken() const { return taken_; }

  // As of Search, of what was ranked.
  bool is_settled() const { return search_.is_settled(); }
  bool explains_scan() const { return search_.explains_scan(); }

  // Whether what the steps so far have aligned may explain the scan, by what it is ranked as, or could be. Else it need not be
  // ranked yet.
  bool may_explain_scan(StageTimes& times) {
    return is_ranked_ || times.of("register", [&] { return search_.may_explain_scan(); });
  }

  // Ranks what the steps so far have aligned.
  void rank(StageTimes& times) {
    if (is_ranked_) return;
    times.of("register", [&] {
      search_.rank({});
      if (map_.effort.is_widened()) search_.search_near();
    });
    is_ranked_ = true;
  }

  // Aligns what one step finds, if the deadline leaves time for it. `rank` then compares it.
  void take(Step step, StageTimes& times) {
    if (expected_s(step, map_.effort, narrow_s_) > options_.deadline.left_s()) return;
    if (step == Step::narrow) {
      const auto began = Deadline::Clock::now();
      by_descriptor(as_measured(), times);
      narrow_s_ = std::chrono::duration<double>(Deadline::Clock::now() - began).count();
    } else if (step == Step::other_ups) {
      by_descriptor(times.of("preprocess", [&] { return with_other_ups(); }), times);
    } else if (map_.effort.is_widened() && !options_.max_candidates) {
      const bool is_last = step == Step::exhaustive;
      by_screening(is_last ? map_.effort.exhaustive : map_.effort.wide, is_last, times);
    } else {
      return;
    }
    taken_.push_back(step);
  }

  // Whether more than a share of the scan lies on the map at a place that the first step would find. It has that much less to do then.
  bool may_fit(double inlier_ratio, StageTimes& times) {
    const std::vector<LevelledScan> levelled = as_measured();
    const Described described = times.of("describe", [&] { return described_of(levelled); });
    const std::vector<Candidate> candidates =
        times.of("search", [&] { return similar(levelled, described, options_.prior, wanted()); });
    align(candidates, times);
    return search_.most_inliers() > inlier_ratio;
  }

  // Registers the best few templates by descriptor, to see whether the scan may be of this map at all. The first step then adds
  // to them.
  void probe(std::size_t count, StageTimes& times) {
    const std::vector<LevelledScan> levelled = as_measured();
    const Described described = times.of("describe", [&] { return described_of(levelled); });
    const std::size_t most = std::min(count, options_.max_candidates.value_or(count));
    const std::vector<Candidate> candidates = times.of("search", [&] { return similar(levelled, described, options_.prior, most); });
    align(candidates, times);
    times.of("register", [&] { search_.rank({}); });
  }

  // Lets the known aliases of the best pose compete, if it would be accepted. Those that were not registered yet are tried if there
  // is time for it.
  void try_aliases(StageTimes& times) {
    const double needed = search_.needed(options_.asked);
    if (!map_.alias_table || !search_.is_accepted(needed)) return;
    const double share = static_cast<double>(map_.aliases.tried) / static_cast<double>(map_.effort.candidates);
    const bool in_time = kSlower * narrow_s_ * share <= options_.deadline.left_s();
    if (in_time) search_.try_aliases(needed, map_.effort.is_widened(), times);
    search_.mark_look_alikes();
    if (in_time && options_.prior) times.of("aliases", [&] { compare_outside(); });
  }

 private:
  using Described = std::vector<FindTemplates>;

  // A candidate as it was found, and where screening moved it to.
  struct Screened {
    Candidate start;
    PoseMatrix T_level_sensor;
    double score;
  };

  void by_descriptor(const std::vector<LevelledScan>& levelled, StageTimes& times) {
    if (levelled.empty()) return;
    const Described described = times.of("describe", [&] { return described_of(levelled); });
    align(times.of("search", [&] { return similar(levelled, described, options_.prior, wanted()); }), times);
  }

  void by_screening(const Effort& effort, bool tilted, StageTimes& times) {
    const std::vector<LevelledScan> levelled = times.of("preprocess", [&] { return levelled_otherwise(tilted); });
    align(times.of("search", [&] { return screened(levelled, effort); }), times);
  }

  void align(const std::vector<Candidate>& candidates, StageTimes& times) {
    times.of("register", [&] { search_.align(candidates, std::nullopt); });
    is_ranked_ = false;
  }

  std::vector<LevelledScan> as_measured() const {
    std::vector<LevelledScan> levelled;
    for (const QueriedScan& one : scans_) levelled.push_back({levelled.size(), one.measured.R_level_sensor, one.height_m, true});
    return levelled;
  }

  // Every scan, levelled by each of the other directions that may be up in the last scan.
  std::vector<LevelledScan> with_other_ups() const {
    const ScanToLevel& last = scans_.back().measured;
    const detail::Vector3 known = detail::in_last(last.T_last_scan, last.R_level_sensor[2]);
    std::vector<LevelledScan> levelled;
    for (const detail::Vector3& up : other_ups(query_.dense.normals.data(), query_.dense.size(), known, options_.gravity)) {
      for (std::size_t number = 0; number < scans_.size(); ++number) {
        const ScanToLevel& scan = scans_[number].measured;
        const detail::Vector3 own_up = detail::in_scan(scan.T_last_scan, up);
        const auto seen_m = height_above_floor(scan.thinned.points, scan.thinned.normals, scan.thinned.count, own_up);
        levelled.push_back({number, detail::levelling_rotation(own_up), seen_m.value_or(map_.default_height_m), false});
      }
    }
    return levelled;
  }

  // Every scan, levelled in each way that is worth a search.
  std::vector<LevelledScan> levelled_otherwise(bool tilted) const {
    std::optional<detail::Vector3> expected_up;
    if (!options_.gravity) expected_up = options_.up_by_mounting;
    std::vector<ScanToLevel> measured;
    for (const QueriedScan& one : scans_) measured.push_back(one.measured);
    const SurfacePoints dense{query_.dense.at.points.data(), query_.dense.normals.data(), query_.dense.size()};
    std::vector<LevelledScan> levelled;
    for (const LevelHypothesis& one : level_hypotheses(measured, dense, expected_up, map_.usual_height_m, tilted)) {
      levelled.push_back({one.scan, one.R_level_sensor, one.height_m, false});
    }
    return levelled;
  }

  Described described_of(const std::vector<LevelledScan>& levelled) const {
    Described made;
    for (const LevelledScan& one : levelled) {
      options_.deadline.check_wanted();
      made.push_back(describe_(scans_[one.scan], one));
    }
    return made;
  }

  std::size_t wanted() const { return options_.max_candidates.value_or(map_.effort.candidates); }

  // Candidates that the prior allows, from the templates most similar to each scan, best first.
  std::vector<Candidate> similar(const std::vector<LevelledScan>& levelled, const Described& described,
                                 const std::optional<PriorRegion>& prior, std::size_t count) const {
    constexpr std::size_t kLeastPerScan = 3;
    const std::size_t each = levelled.size() > 1 ? std::max(kLeastPerScan, 2 * count / levelled.size()) : count;
    return merged(levelled, described, prior, {each, map_.effort.clusters});
  }

  // Distinct candidates whose poses fit the coarse map best, best first. The descriptor alone mistakes the place where sparse
  // beams, occluders or a wrong up change many cells. A hundred points of the scan tell the places apart at a tenth of a
  // registration's time. The scans, each levelled in one way or several, share the effort. Where a step before has screened, only
  // templates that are promising by that are compared, and the effort is as large a part as they are of all.
  std::vector<Candidate> screened(const std::vector<LevelledScan>& levelled, const Effort& effort) {
    const auto share = [&](std::size_t all) { return std::max<std::size_t>(1, all / levelled.size()); };
    Wanted each{share(effort.screened), share(effort.clusters), false};
    TemplateRows promising;
    if (!screened_.empty()) {
      promising = promising_of_screened();
      each.among = &promising;
      each.most = share(effort.screened * promising.size() / map_.places->count);
    }
    std::vector<Candidate> candidates = merged(levelled, described_of(levelled), options_.prior, each);
    // neighbours read the same part of the map
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& one, const Candidate& other) { return one.template_row < other.template_row; });
    screen(candidates);
    sort_by_score(candidates);
    std::vector<Candidate> distinct;
    const double within_m = map_.ranking.same_pose_m, within_rad = radians(map_.ranking.same_pose_deg);
    for (const auto row : distinct_poses(poses_of(candidates), within_m, within_rad, effort.candidates)) {
      distinct.push_back(candidates[static_cast<std::size_t>(row)]);
    }
    return distinct;
  }

  TemplateRows promising_of_screened() const {
    std::vector<std::pair<std::int64_t, double>> before;
    for (const Screened& one : screened_) before.emplace_back(one.start.template_row, one.score);
    return promising_templates(*map_.places, map_.spacing_m, before);
  }

  // Moves candidates, in the order of their templates, towards the map, and scores them there. The last step asks for much of what
  // the step before it has screened.
  void screen(std::vector<Candidate>& candidates) {
    std::vector<Screened> found;
    std::vector<std::size_t> fresh;
    std::vector<PoseMatrix> starts;
    auto known = screened_.cbegin();
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      const Candidate& one = candidates[i];
      while (known != screened_.cend() && known->start.template_row < one.template_row) ++known;
      auto same = known;
      const auto is_other = [&] { return same->start.template_row == one.template_row && same->start.T_level_sensor != one.T_level_sensor; };
      while (same != screened_.cend() && is_other()) ++same;
      const bool is_known = same != screened_.cend() && same->start.template_row == one.template_row;
      found.push_back(is_known ? *same : Screened{one, {}, 0});
      if (is_known) continue;
      fresh.push_back(i);
      starts.push_back(one.T_level_sensor);
    }
    ScanOnCells few(map_, query_.sparse, map_.ranking.screen_points, options_.deadline);
    const std::vector<Registration> placed = few.align(starts, std::nullopt, map_.barely());
    for (std::size_t k = 0; k < fresh.size(); ++k) {
      found[fresh[k]].T_level_sensor = placed[k].T_level_sensor, found[fresh[k]].score = placed[k].alignment_score;
    }
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      candidates[i].T_level_sensor = found[i].T_level_sensor, candidates[i].score = found[i].score;
    }
    screened_ = std::move(found);
  }

  // Of all scans, most similar first.
  std::vector<Candidate> merged(const std::vector<LevelledScan>& levelled, const Described& described,
                                const std::optional<PriorRegion>& prior, const Wanted& each) const {
    std::vector<Candidate> all;
    for (std::size_t i = 0; i < levelled.size(); ++i) {
      options_.deadline.check_wanted();
      const PoseMatrix& T_last_scan = scans_[levelled[i].scan].measured.T_last_scan;
      const auto some = similar_places(*map_.places, map_.spacing_m, described[i], T_last_scan, levelled[i], prior, each);
      all.insert(all.end(), some.begin(), some.end());
    }
    if (levelled.size() > 1) sort_by_score(all);
    return all;
  }

  // Compares the best pose with places outside the prior, if an alias there fits nearly as well.
  //
  // Is the prior wrong? Those that are as good do not count: which of them is right, the prior says. One that is clearly better
  // shows that the prior is wrong: the scan was taken there. Most places have no alias, and a prior saves the search of the whole
  // map.
  void compare_outside() {
    std::vector<Candidate> places = search_.aliases_outside();
    if (places.empty()) return;
    const std::vector<LevelledScan> levelled = as_measured();
    const std::vector<Candidate> anywhere = similar(levelled, described_of(levelled), std::nullopt, wanted());
    places.insert(places.end(), anywhere.begin(), anywhere.end());
    sort_by_score(places);
    Search outside(map_, query_, std::nullopt, options_.deadline);
    outside.run(places, search_.found().front().registration.twist, {});
    outside_lead_ = search_.lead_outside(outside.found());
  }

  const SearchedMap& map_;
  const SearchedQuery& query_;
  std::vector<QueriedScan> scans_;
  Describe describe_;
  SearchOptions options_;
  Search search_;
  std::vector<Step> taken_;
  bool is_ranked_ = true;
  std::vector<Screened> screened_;  // by the last step that screened, in the order of their templates
  double narrow_s_ = 0, outside_lead_ = 0;
};

}  // namespace firstfix
