// A robot's scan and options, checked, and the scan prepared for a version.
#pragma once

#include <optional>

#include "engine_numbers.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/version/places_options.hpp"

namespace firstfix::version {

// Nothing if the scan has too few points. Throws Error "invalid_scan", "invalid_option" or "too_large".
std::optional<PreparedScan> prepared(const Scan& scan, const PlacesOptions& options, const EngineNumbers& numbers);

}  // namespace firstfix::version
