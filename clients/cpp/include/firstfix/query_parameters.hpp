// What a robot needs to know of a map to describe its scans as the map's templates are described.
#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "errors.hpp"

namespace firstfix {

// Layered occupancy: `engine.descriptor` of the map's manifest.
struct DescriptorParameters {
  std::size_t rings = 20, sectors = 60;
  double max_range_m = 60;
  std::vector<double> layer_edges_m{0.3, 1.0, 1.8, 3.0, 6.0, 25.0};

  std::size_t layers() const { return layer_edges_m.empty() ? 0 : layer_edges_m.size() - 1; }
  std::size_t bits() const { return layers() * rings * sectors; }
  std::size_t bytes() const { return (bits() + 7) / 8; }
};

// The defaults suit every map; a descriptor belongs to one map's version. Client::query_parameters fetches them.
struct QueryParameters {
  double min_range_m = 0.5, max_range_m = 60;
  double voxel_m = 0.3;
  double default_height_m = 1;  // of the sensor, where no floor is seen
  std::optional<DescriptorParameters> descriptor;
};

namespace detail {

inline bool usable(const DescriptorParameters& d) {
  bool ok = d.rings >= 1 && d.rings <= 200 && d.sectors >= 1 && d.sectors <= 720 && d.layers() >= 1 &&
            d.layers() <= 16 && d.max_range_m > 0 && d.max_range_m <= 1000;
  for (std::size_t i = 0; ok && i < d.layer_edges_m.size(); ++i) {
    ok = std::fabs(d.layer_edges_m[i]) <= 1e6 && (i == 0 || d.layer_edges_m[i - 1] < d.layer_edges_m[i]);
  }
  return ok;
}

// Throws "invalid_option" for what no map has, before any of it is computed with.
inline void check(const QueryParameters& p) {
  const bool ok = p.min_range_m >= 0 && p.min_range_m <= 1e4 && p.max_range_m > 0 && p.max_range_m <= 1e4 &&
                  p.voxel_m >= 0.01 && p.voxel_m <= 10 && std::fabs(p.default_height_m) <= 100 &&
                  (!p.descriptor || (usable(*p.descriptor) && p.descriptor->max_range_m >= 0.01));
  if (!ok) throw Error("invalid_option", "these are no map's query parameters");
}

}  // namespace detail
}  // namespace firstfix
