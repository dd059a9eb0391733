// The numbers of a version's engine.json by which scans are prepared, templates found, and poses registered and ranked.
#pragma once

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/query/searched_map.hpp"
#include "mapped_file.hpp"

namespace firstfix::version {

struct EngineNumbers {
  LayeredGrid grid;
  std::size_t coefficients;
  Preparation preparation;
  double default_height_m, spacing_m;
  EffortNumbers effort;
  PoseMatrix T_map_level;
  RegistrationNumbers registration;
  NearbyNumbers nearby;
  AliasNumbers aliases;
  Ranking ranking;
  double spots_apart_m;  // nearer to each other, scans show the same surfaces again
  double reach_m;        // of the free-space check
  std::size_t compared;  // candidates that compete, at most
};

// Throws Error "corrupt_version", or "incompatible_version" if the templates have another descriptor, or poses another ranking.
EngineNumbers engine_numbers(const MappedFile& file);

}  // namespace firstfix::version
