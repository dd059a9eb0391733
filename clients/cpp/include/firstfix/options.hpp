// What a caller may ask of one localization: clients/PROTOCOL.md, Options.
#pragma once

#include <array>
#include <cmath>
#include <locale>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "errors.hpp"
#include "pose.hpp"

namespace firstfix {

// Where the sensor is known to be in the map.
struct Prior {
  std::array<double, 3> position{};  // m
  double radius_m = 0;
  double yaw_deg = 0, yaw_range_deg = 180;  // 180: any heading
};

struct LocalizeOptions {
  std::optional<std::array<double, 3>> gravity;  // direction in the sensor frame, downwards
  std::optional<Prior> prior;
  std::optional<Pose> T_base_sensor;  // mounting: the answer then has T_map_base
  std::optional<int> max_candidates;
  std::optional<double> min_probability;
  std::optional<double> deadline_ms;
  std::optional<std::string> version;
};

using Strings = std::vector<std::pair<std::string, std::string>>;

namespace detail {

// Of enough digits to be the same double again, whatever the process's locale.
inline std::string joined(const std::vector<double>& numbers) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text.precision(17);
  const char* between = "";
  for (const double v : numbers) {
    if (!std::isfinite(v)) throw Error("invalid_option", "an option holds a number that is not finite");
    text << between << v;
    between = ",";
  }
  return text.str();
}

}  // namespace detail

// Names and values as query parameters, not escaped. Throws "invalid_option" for numbers that are not finite.
inline Strings strings_of(const LocalizeOptions& options) {
  Strings strings;
  const auto add = [&strings](const char* name, const std::vector<double>& numbers) {
    strings.emplace_back(name, detail::joined(numbers));
  };
  if (options.gravity) add("gravity", {options.gravity->begin(), options.gravity->end()});
  if (options.prior) {
    const Prior& prior = *options.prior;
    std::vector<double> numbers{prior.position[0], prior.position[1], prior.position[2], prior.radius_m};
    if (prior.yaw_range_deg < 180) numbers.insert(numbers.end(), {prior.yaw_deg, prior.yaw_range_deg});
    add("prior", numbers);
  }
  if (options.T_base_sensor) {
    if (!detail::usable(*options.T_base_sensor)) throw Error("invalid_option", "T_base_sensor is no pose");
    const Pose pose = detail::normalised(*options.T_base_sensor);
    std::vector<double> numbers(pose.position.begin(), pose.position.end());
    numbers.insert(numbers.end(), pose.quaternion.begin(), pose.quaternion.end());
    add("T_base_sensor", numbers);
  }
  if (options.max_candidates) add("max_candidates", {static_cast<double>(*options.max_candidates)});
  if (options.min_probability) add("min_probability", {*options.min_probability});
  if (options.deadline_ms) add("deadline_ms", {*options.deadline_ms});
  if (options.version) strings.emplace_back("version", *options.version);
  return strings;
}

}  // namespace firstfix
