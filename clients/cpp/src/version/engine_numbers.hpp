// The numbers of a version's engine.json that finding templates needs.
#pragma once

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "mapped_file.hpp"

namespace firstfix::version {

struct EngineNumbers {
  LayeredGrid grid;
  std::size_t coefficients;
  Preparation preparation;
  double default_height_m, spacing_m;
  std::size_t clusters, candidates;
  PoseMatrix T_map_level;
};

// Throws Error "corrupt_version", or "incompatible_version" if the templates have another descriptor.
EngineNumbers engine_numbers(const MappedFile& file);

}  // namespace firstfix::version
