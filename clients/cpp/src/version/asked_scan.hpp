// A robot's scans, prepared for a version.
#pragma once

#include <optional>
#include <vector>

#include "engine_numbers.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/query/prior.hpp"
#include "firstfix/query/similar_places.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/sequence.hpp"
#include "firstfix/scan/twist.hpp"
#include "firstfix/version/places_options.hpp"

namespace firstfix::version {

// One scan of a query, whole or compact, and its pose in the frame of the query's last scan.
struct AskedScan {
  const Scan* whole;
  const CompactScan* compact;  // if it is not whole
  PoseMatrix T_last_scan;
};
using AskedScans = std::vector<AskedScan>;

AskedScans asked(const Scan& scan);
AskedScans asked(const CompactScan& scan);
// Throws Error "invalid_scan" or "too_large".
AskedScans asked(const ScanSequence& sequence);

struct PlacedScan {
  PoseMatrix T_last_scan;
  PreparedScan prepared;
  const ScanDescriptor* described;  // by the robot, which had all points; null: not known
};

// The scans that have enough points, which may be none. options: checked. twist: of the sensor during the last scan, by which it
// is deskewed; nothing: not known. Throws Error "invalid_scan", "invalid_option" or "too_large".
std::vector<PlacedScan> prepared(const AskedScans& scans, const PlacesOptions& options, const EngineNumbers& numbers,
                                 const std::optional<Twist>& twist = std::nullopt);

// Up in the sensor frame by its mounting on a robot that stands nearly upright; without one, along the sensor's own z.
detail::Vector3 up_by_mounting(const std::optional<Pose>& T_base_sensor);

// The scan as templates are found for it. It refers to `scan`.
QueriedScan queried(const PlacedScan& scan);

std::optional<PriorRegion> region_of(const std::optional<Prior>& prior, const PoseMatrix& T_map_level);

}  // namespace firstfix::version
