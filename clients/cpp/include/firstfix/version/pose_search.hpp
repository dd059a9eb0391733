// Poses of a map at which a scan fits, found on the robot itself: no service, no Python.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/errors.hpp"
#include "firstfix/query/ranking.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/version/places_options.hpp"

namespace firstfix {

// A pose of the sensor to which a scan was aligned. support: by it poses are ranked; only differences of it mean something.
// fit: shares, 0..1, of how the scan fits the map there. rests: whether the alignment came to rest.
struct RankedPose {
  PoseMatrix T_map_sensor;
  double support;
  Fit fit;
  bool rests;
  std::int64_t template_row;
};

// The templates, the surface and the free space of a version, memory-mapped: its folder is maps/MAP/versions/VERSION of a
// store. What it finds is what a service's first search finds, to the last bit. It is no fix: a service goes on to compare
// known look-alikes and other ups, and judges the best pose. Threads may share it.
class PoseSearch {
 public:
  // As TemplateSearch, of more files.
  explicit PoseSearch(const std::string& folder);
  ~PoseSearch();
  PoseSearch(PoseSearch&&) noexcept;
  PoseSearch& operator=(PoseSearch&&) noexcept;

  // Name of the version: the manifest's sha256.
  const std::string& version() const;

  // Distinct poses that the prior allows, best first. options: max_places are registered. None if the scan has too few
  // points, or no template lies within the prior. Throws Error "invalid_scan" or "invalid_option".
  std::vector<RankedPose> find(const Scan& scan, const PlacesOptions& options = {}) const;

 private:
  struct Opened;
  std::unique_ptr<const Opened> opened_;
};

}  // namespace firstfix
