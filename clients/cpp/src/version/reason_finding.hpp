// The finding that says with numbers why a scan is not localized, as a service's (firstfix.engine.diagnosis.place_findings).
#pragma once

#include <optional>

#include "firstfix/answer/documents.hpp"

namespace firstfix::version {

// Of the first reason of an answer; nothing if it has none of its own.
std::optional<Finding> reason_finding(const Localization& answer);

}  // namespace firstfix::version
