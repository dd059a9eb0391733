// A version of a map as a search reads it: tables that somebody else keeps, and the version's numbers.
#pragma once

#include <cstddef>
#include <optional>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/calibration.hpp"
#include "firstfix/query/effort.hpp"
#include "firstfix/query/ranking.hpp"
#include "firstfix/registration/align.hpp"
#include "firstfix/registration/surface_grid.hpp"
#include "firstfix/retrieval/alias_table.hpp"
#include "firstfix/retrieval/template_tiles.hpp"
#include "firstfix/verification/point_tiles.hpp"
#include "firstfix/verification/seen_free.hpp"

namespace firstfix {

// firstfix.engine.config.RegistrationConfig, under the same names.
struct RegistrationNumbers {
  double map_voxel_m, coarse_voxel_m;
  int coarse_iterations, align_iterations;
  double fine_distance_m, inlier_distance_m;
};

// firstfix.engine.config.NearbyConfig, under the same names.
struct NearbyNumbers {
  double reach_m, step_m;
  std::size_t points;
  double worse_by;
  std::size_t refined;
  double apart_m, apart_deg, better_by;
};

// firstfix.engine.config.AliasConfig, under the same names.
struct AliasNumbers {
  double near_m, behind;
  std::size_t templates, screened, tried;
};

// The templates of a version by their places.
struct TemplatePlaces {
  const float* position_m = nullptr;  // (n, 3) of the sensor
  const float* height_m = nullptr;    // (n) of the sensor above its floor
  std::size_t count = 0;
  TemplateTiles tiles;
};

struct SearchedMap {
  PoseMatrix T_map_level;  // from the level frame, in which it is searched, to the map's own
  SurfaceGrid fine, coarse;
  PointTiles near, far;
  std::optional<SeenFree> seen_free;
  std::optional<TemplatePlaces> places;
  std::optional<AliasTable> alias_table;  // of these templates; none of a version that has none
  double reach_m;    // of the free-space check
  double spacing_m;  // between templates
  RegistrationNumbers registration;
  NearbyNumbers nearby;
  AliasNumbers aliases;
  Ranking ranking;
  Calibration calibration;
  std::size_t compared;  // candidates that compete, at most
  EffortNumbers effort;
  double usual_height_m;    // of the map's own sensor above its floor
  double default_height_m;  // of a sensor above the floor, where no floor is seen

  // A little towards the map, on the coarse grid: without it a start half a metre off scores no better than a wrong one.
  AlignParameters barely() const { return on_cells(ranking.screen_iterations); }

  // From starts within about a metre, on the coarse grid.
  AlignParameters coarsely() const { return on_cells(registration.coarse_iterations); }

  // From starts within a few decimetres.
  AlignParameters usually() const { return on_points(registration.align_iterations, ranking.align_angle); }

  // With little regard to normals: starts within two decimetres end near one pose.
  AlignParameters smoothly() const { return on_points(ranking.smooth_iterations, ranking.smooth_angle); }

  // Until nothing moves. Where walls face one way only, an alignment creeps a few centimetres an iteration.
  AlignParameters finely() const { return on_points(60, ranking.fine_angle); }

 private:
  AlignParameters on_cells(int iterations) const {
    return {iterations, static_cast<float>(1.5 * registration.coarse_voxel_m), static_cast<float>(ranking.coarse_angle)};
  }

  AlignParameters on_points(int iterations, double half_angle) const {
    return {iterations, static_cast<float>(registration.fine_distance_m), static_cast<float>(half_angle)};
  }
};

}  // namespace firstfix
