// The search for a query's poses, on maps, scans and candidates that hold any numbers.
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "firstfix/query/search.hpp"
#include "hostile.hpp"
#include "random_grid.hpp"

namespace firstfix::tests {
namespace {

// The tables of a map, which the searched one reads.
struct RandomMap {
  RandomGrid fine, coarse;
  std::vector<float> points;
  std::vector<std::int32_t> begin;
  std::vector<float> position_m, height_m;
  std::vector<std::int32_t> tile_row, tile_begin, alias_row;
  std::vector<std::uint8_t> turn, score;
  SearchedMap map;

  RandomMap(Hostile& random, double wrong) : fine(random, wrong), coarse(random, wrong) {
    const std::int64_t columns = random.number(1, 6), rows = random.number(1, 6), count = random.number(0, 800);
    points = random.floats(static_cast<std::size_t>(3 * count), 12, wrong);
    begin = random.pointers(static_cast<std::size_t>(columns * (rows + 1)), count, wrong);
    const PointTiles tiles{points.data(), count, begin.data(), columns, rows, {-3, -3}};
    map.fine = fine.grid, map.coarse = coarse.grid, map.near = tiles, map.far = tiles, map.reach_m = 25;
    map.registration = {0.1, 0.6, 3, 2, 0.5, 0.15};
    map.nearby = {1, 0.5, 40, 0.05, 3, 0.15, 1, 0.01};
    map.aliases = {5, 0.15, 4, 20, 3};
    map.spacing_m = 1;
    take_places(random, wrong);
    take_numbers(random);
  }

 private:
  // All templates are in one tile.
  void take_places(Hostile& random, double wrong) {
    const auto count = static_cast<std::size_t>(random.number(0, 30));
    constexpr std::size_t kEach = 3;
    position_m = random.floats(3 * count, 4, wrong), height_m = random.floats(count, 2, wrong);
    for (std::size_t i = 0; i < count; ++i) tile_row.push_back(static_cast<std::int32_t>(i));
    tile_begin = {0, static_cast<std::int32_t>(count)};
    map.places = TemplatePlaces{position_m.data(), height_m.data(), count, {tile_row.data(), tile_begin.data(), 1, 1, {0, 0}}};
    map.places->tiles.check(count);
    if (random.chance(0.3)) return;
    for (std::size_t i = 0; i < kEach * count; ++i) {
      alias_row.push_back(static_cast<std::int32_t>(random.number(-2, static_cast<std::int64_t>(count) - 1)));
      turn.push_back(static_cast<std::uint8_t>(random.number(0, 255)));
      score.push_back(static_cast<std::uint8_t>(random.number(0, 255)));
    }
    map.alias_table = AliasTable{alias_row.data(), turn.data(), score.data(), count, kEach};
    map.alias_table->check();
  }

  void take_numbers(Hostile& random) {
    Ranking& r = map.ranking;
    r.alignment_weight = 0.25, r.removed_weight = 0.04, r.violation_weight = 0.06, r.seen_free_weight = 0.07;
    r.seen_free_offset = 0.05, r.best_score = 1.05, r.least_share = 0.001, r.worst_score = 0.02, r.violation_offset = 0.005;
    r.beside_offset = 0.02, r.same_plane_offset = 0.02, r.max_margin = 0.25, r.unlikely_m_s = 3, r.unlikely_rad_s = 4;
    r.motion_score_weight = 2.5, r.promising = 0.02, r.likely = 0.5, r.convincing_inlier_ratio = 0.75;
    r.same_pose_m = 1, r.same_pose_deg = 15, r.same_start_m = 0.3;
    r.same_start_deg = 3, r.rival_within = 0.3, r.max_refined = 3, r.neighbour_m = 0.3, r.slid_m = 0.25, r.better_by = 0.02;
    r.maybe_better_by = 0.01, r.screen_points = 20, r.coarse_points = 40, r.screen_iterations = 2, r.smooth_iterations = 2;
    r.coarse_angle = 0.2, r.align_angle = 0.06, r.smooth_angle = 0.5, r.fine_angle = 0.2;
    r.twist_scale = {1, 1, 1e-6, 1e-6, 1e-6, 1};
    Calibration& c = map.calibration;
    c.model = {random.chance(0.5) ? -20.1 : 5, 1.45, 1.74, 2.5, 1.66, 21.1};
    if (random.chance(0.5)) c.among_tied = Calibration::Model{-8, 1, 1, 1, 1, 1};
    c.min_probability = c.search_until = 0.9, c.min_inlier_ratio = 0.05, c.max_free_space_violation = 0.5;
    c.min_margin = 0.05, c.alias_margin = 0.08, c.is_prior = random.chance(0.5);
    map.compared = static_cast<std::size_t>(random.number(0, 12));
  }
};

ScannedSurface surface(Hostile& random, std::size_t count, bool in_time, double wrong) {
  ScannedSurface made;
  made.at.points = random.floats(3 * count, 4, wrong), made.normals = random.floats(3 * count, 1, wrong);
  made.oriented.assign(count, 1);
  if (in_time) made.at.time_s = random.floats(count, 0.05, 0);
  return made;
}

void check(const Search& search) {
  const RegisteredPoses& found = search.found();
  for (std::size_t i = 0; i < found.size(); ++i) {
    const RegisteredPose& one = found[i];
    expect(std::isfinite(one.support), "a support");
    expect(i == 0 || found[i - 1].support >= one.support, "best first");
    expect(one.fit.inlier_ratio >= 0 && one.fit.inlier_ratio <= 1, "inlier ratio within 0 and 1");
    expect(one.is_measured, "every agreement is measured");
  }
}

void decide(Hostile& random, const SearchedMap& map, const Search& search) {
  std::vector<Competitor> ranked;
  for (const RegisteredPose& one : search.found()) {
    const auto spots = static_cast<std::size_t>(random.number(1, 4));
    const double outside_lead = random.chance(0.2) ? random.real(1, 0) : 0;
    ranked.push_back({0, one.fit, one.support, spots, one.is_alike, outside_lead, one.registration.rests,
                      is_in_motion(one.registration)});
  }
  const std::vector<JudgingMap> maps{{map.ranking, map.calibration}};
  const Decision found = Judge(maps, ranked).decided(random.real(1));
  expect(found.shares.size() == ranked.size(), "one share for each pose");
  for (const double share : found.shares) expect(share >= -1e-9 && share <= 1 + 1e-9, "a share within 0 and 1");
}

void search_once(Hostile& random) {
  const double wrong = random.chance(0.5) ? 0.1 : 0;
  const RandomMap tables(random, wrong);
  const bool in_time = random.chance(0.3);
  const auto count = static_cast<std::size_t>(random.number(0, 120));
  SearchedQuery query{{}, surface(random, count, in_time, 0), surface(random, count / 2, in_time, 0), 1};
  if (count < 2 && in_time) return;  // a scan with times has points
  ViewedScan scan{pose(random, 0), {std::vector<std::uint8_t>(kDirections, 1), std::vector<float>(kDirections, 5.0F)}, {}};
  if (in_time) scan.returns = query.dense.at;
  query.scans.push_back(scan);
  std::optional<PriorRegion> prior;
  if (random.chance(0.3)) prior = PriorRegion{pose(random, 0), {random.real(4, 0), 0, 0}, 5, random.real(180, 0), 90};
  Search search(tables.map, query, prior);
  std::vector<Candidate> candidates;
  for (int run = 0; run < 3; ++run) {
    candidates.clear();
    std::vector<PoseMatrix> aliases;
    for (std::int64_t i = random.number(0, 8); i > 0; --i) {
      candidates.push_back({i, pose(random, 0), random.real(1, 0)});
      aliases.push_back(pose(random, 0));
    }
    KnownTwist twist;
    if (random.chance(0.3)) twist = Vector6{1, 0, 0, 0, 0, 0.5};
    search.run(candidates, twist, aliases);
    check(search);
    search.search_near();
    check(search);
    expect(search.rivals(candidates, 0.5).size() <= candidates.size(), "rows of the aliases");
    search.leaves_out(aliases);
    search.is_settled();
    search.explains_scan();
    StageTimes times;
    search.try_aliases(search.needed(random.real(1)), random.chance(0.5), times);
    search.mark_look_alikes();
    check(search);
    decide(random, tables.map, search);
    expect(prior || search.aliases_outside().empty(), "nothing is outside where there is no prior");
    for (const Candidate& one : search.aliases_outside()) expect(!prior->allows(one.T_level_sensor), "an alias outside");
    expect(search.found().empty() || search.lead_outside(search.found()) == 0, "what the prior allows is not outside");
  }
  for (const std::int64_t row : search.untried(candidates, std::nullopt)) {
    expect(row >= 0 && row < static_cast<std::int64_t>(candidates.size()), "a row of the candidates");
  }
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::search_once(random);
  }
}
