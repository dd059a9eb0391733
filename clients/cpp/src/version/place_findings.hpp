// Findings by the best place of an answer: why it is not localized, and how its sensor stands.
#pragma once

#include <optional>

#include "firstfix/answer/documents.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix::version {

// The finding that says the first reason of an answer with its numbers, if it has one of its own.
std::optional<Finding> reason_finding(const Localization& answer);

// The finding that a localized robot, or its sensor, does not stand upright in the map. Gravity says how a sensor hangs, so it is
// only told where the query has none.
std::optional<Finding> mounting_finding(const PoseMatrix& T_map_sensor, const LocalizeOptions& options);

}  // namespace firstfix::version
