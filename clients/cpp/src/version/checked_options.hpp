// Options of a query, within the bounds of a service's (firstfix.answer.options), with its messages.
#pragma once

#include "firstfix/answer/options.hpp"
#include "firstfix/version/places_options.hpp"

namespace firstfix::version {

// The options with directions and quaternions of unit length. Throws Error "invalid_option".
LocalizeOptions checked(const LocalizeOptions& options);
PlacesOptions checked(const PlacesOptions& options);

}  // namespace firstfix::version
