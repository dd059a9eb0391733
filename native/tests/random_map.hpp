// Maps and scans that hold any numbers, for the search in them.
#pragma once

#include <cstdint>
#include <vector>

#include "firstfix/query/search.hpp"
#include "hostile.hpp"
#include "random_grid.hpp"

namespace firstfix::tests {

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
    map.T_map_level = {0, -1, 0, 5, 1, 0, 0, -3, 0, 0, 1, 0.5, 0, 0, 0, 1};
    map.fine = fine.grid, map.coarse = coarse.grid, map.near = tiles, map.far = tiles, map.reach_m = 25;
    map.registration = {0.1, 0.6, 3, 2, 0.5, 0.15};
    map.nearby = {1, 0.5, 40, 0.05, 3, 0.15, 1, 0.01};
    map.aliases = {5, 0.15, 4, 20, 3};
    map.spacing_m = 1, map.usual_height_m = 1.4, map.default_height_m = 1;
    map.effort = {20, 5, random.chance(0.2) ? 1U : 4U, {60, 40, 6}, {90, 50, 6}};
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

inline ScannedSurface surface(Hostile& random, std::size_t count, bool in_time, double wrong) {
  ScannedSurface made;
  made.at.points = random.floats(3 * count, 4, wrong), made.normals = random.floats(3 * count, 1, wrong);
  made.oriented.assign(count, 1);
  if (in_time) made.at.time_s = random.floats(count, 0.05, 0);
  return made;
}

}  // namespace firstfix::tests
