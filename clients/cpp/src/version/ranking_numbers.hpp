// The numbers by which a version's poses are ranked and judged.
#pragma once

#include <optional>

#include "fields.hpp"
#include "firstfix/query/calibration.hpp"
#include "firstfix/query/ranking.hpp"
#include "mapped_file.hpp"

namespace firstfix::version {

// `ranking` of engine.json. Throws Error "corrupt_version", or "incompatible_version" if it has other numbers than this library
// ranks by.
Ranking ranking_numbers(const Json& stored);

struct Calibrations {
  Calibration usual;
  std::optional<Calibration> with_prior;  // of queries with a prior that is not wide

  // For a query with a prior of this radius, or without one.
  const Calibration& judging(const std::optional<double>& radius_m) const;
};

// calibration.json. Throws as ranking_numbers.
Calibrations calibrations(const MappedFile& file);

}  // namespace firstfix::version
