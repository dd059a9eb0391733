// Places of a map that resemble a scan, found on the robot itself: no service, no Python.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/errors.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/version/places_options.hpp"

namespace firstfix {

// A pose of the sensor at which a scan resembles a template of the map. It is a start for a registration, not a fix: some
// decimetres and degrees off, and often of a place that only looks alike.
struct SimilarPlace {
  PoseMatrix T_map_sensor;
  double score;  // 0..1, similarity of the descriptors
  std::int64_t template_row;
};

// The templates of a version, memory-mapped: its folder is maps/MAP/versions/VERSION of a store. What it finds is what a
// service finds first, to the last bit. Threads may share it.
class TemplateSearch {
 public:
  // Compares each file that it reads with its size and sha256 in the manifest. Throws Error with the code not_found,
  // corrupt_version or incompatible_version (another format, or templates that need a service: over 250,000, or not of the
  // default descriptor). A file must not be cut off while it is open.
  explicit TemplateSearch(const std::string& folder);
  ~TemplateSearch();
  TemplateSearch(TemplateSearch&&) noexcept;
  TemplateSearch& operator=(TemplateSearch&&) noexcept;

  // Name of the version: the manifest's sha256.
  const std::string& version() const;

  // Places that resemble the scan, the most similar first. None if the scan has too few points, or no template lies within
  // the prior. Throws Error "invalid_scan" or "invalid_option".
  std::vector<SimilarPlace> find(const Scan& scan, const PlacesOptions& options = {}) const;

 private:
  struct Opened;
  std::unique_ptr<const Opened> opened_;
};

}  // namespace firstfix
