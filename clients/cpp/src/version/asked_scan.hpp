// A robot's scan, prepared for a version.
#pragma once

#include <optional>

#include "engine_numbers.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/twist.hpp"
#include "firstfix/version/places_options.hpp"

namespace firstfix::version {

// Nothing if the scan has too few points. options: checked. twist: of the sensor during the scan, by which it is deskewed; nothing: not known.
// Throws Error "invalid_scan", "invalid_option" or "too_large".
std::optional<PreparedScan> prepared(const Scan& scan, const PlacesOptions& options, const EngineNumbers& numbers,
                                     const std::optional<Twist>& twist = std::nullopt);

// Up in the sensor frame by its mounting on a robot that stands nearly upright; without one, along the sensor's own z.
detail::Vector3 up_by_mounting(const std::optional<Pose>& T_base_sensor);

}  // namespace firstfix::version
