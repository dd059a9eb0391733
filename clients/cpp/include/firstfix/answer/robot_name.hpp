// Names of robots, by which people tell them from others.
#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <string_view>

#include "firstfix/errors.hpp"

namespace firstfix {

using RobotName = std::optional<std::string>;

// Throws "invalid_option" for a name that is not 1 to 64 of A-Z a-z 0-9 . _ : @ / -, or that does not begin with a
// letter, a digit or a slash: a ROS namespace, or a serial number of VDA 5050.
inline const std::string& checked_robot_name(const std::string& name) {
  constexpr std::string_view kFirst = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789/", kMore = "._:@-";
  const auto is_first = [&](char one) { return kFirst.find(one) != kFirst.npos; };
  const auto is_allowed = [&](char one) { return is_first(one) || kMore.find(one) != kMore.npos; };
  if (name.empty() || name.size() > 64 || !is_first(name[0]) || !std::all_of(name.begin(), name.end(), is_allowed)) {
    throw Error("invalid_option", "not a robot's name (1 to 64 of A-Z a-z 0-9 . _ : @ / -): " + name.substr(0, 80));
  }
  return name;
}

}  // namespace firstfix
