// A query as a robot sends it: its scans, and where it knows itself to be.
#pragma once

#include <optional>
#include <vector>

#include "engine_numbers.hpp"
#include "firstfix/query/prepared_query.hpp"
#include "firstfix/query/prior.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/sequence.hpp"
#include "firstfix/scan/twist.hpp"
#include "firstfix/version/places_options.hpp"

namespace firstfix::version {

// One scan of a query, whole or compact, and its pose in the frame of the query's last scan.
struct SentScan {
  const Scan* whole;
  const CompactScan* compact;  // if it is not whole
  PoseMatrix T_last_scan;
};
using SentScans = std::vector<SentScan>;

// They refer to what is given.
SentScans sent(const Scan& scan);
SentScans sent(const CompactScan& scan);
// Throws Error "invalid_scan" or "too_large".
SentScans sent(const ScanSequence& sequence);

// The query of these scans as a version needs it; nothing if none of them has enough points. options: checked. twist: of the sensor
// during the last scan, by which it is deskewed; nothing: not known. Throws Error "invalid_scan", "invalid_option" or "too_large".
std::optional<PreparedQuery> prepared(const SentScans& scans, const PlacesOptions& options, const EngineNumbers& numbers,
                                      const std::optional<Twist>& twist = std::nullopt);

std::optional<PriorRegion> region_of(const std::optional<Prior>& prior, const PoseMatrix& T_map_level);

}  // namespace firstfix::version
