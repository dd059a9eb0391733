// Parameters with which a robot condenses and describes its scans.
#pragma once

#include <cmath>
#include <optional>

#include "firstfix/descriptor/layered_occupancy.hpp"
#include "firstfix/errors.hpp"

namespace firstfix {

// The defaults are right for every map if there is no descriptor. The parameters of a descriptor belong to one version
// of a map: Client::descriptor_parameters fetches them.
struct DescriptorParameters {
  double min_range_m = 0.5, max_range_m = 60;  // returns outside are left out
  double voxel_m = 0.3;
  double default_height_m = 1;  // of the sensor above the floor, if the scan shows no floor
  std::optional<LayeredOccupancy> descriptor;
};

namespace detail {

// Throws "invalid_option" for values that no map has, before anything is computed with them.
inline void check(const DescriptorParameters& p) {
  const bool ok = p.min_range_m >= 0 && p.min_range_m <= 1e4 && p.max_range_m > 0 && p.max_range_m <= 1e4 &&
                  p.voxel_m >= 0.01 && p.voxel_m <= 10 && std::fabs(p.default_height_m) <= 100 &&
                  (!p.descriptor || (usable(*p.descriptor) && p.descriptor->max_range_m >= 0.01));
  if (!ok) throw Error("invalid_option", "a descriptor parameter is out of range");
}

}  // namespace detail
}  // namespace firstfix
