// Options of one query: clients/PROTOCOL.md, Options.
#pragma once

#include <array>
#include <cmath>
#include <locale>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/pose.hpp"
#include "firstfix/scan/twist.hpp"

namespace firstfix {

// The region of the map where the sensor is known to be.
struct Prior {
  std::array<double, 3> position{};  // m
  double radius_m = 0;
  double yaw_deg = 0, yaw_range_deg = 180;  // 180: any heading
};

struct LocalizeOptions {
  std::optional<std::array<double, 3>> gravity;  // points down, in the sensor frame
  std::optional<Prior> prior;
  std::optional<Pose> T_base_sensor;  // mounting of the sensor; the answer then has T_map_base
  std::optional<int> max_candidates;
  std::optional<double> min_probability;
  std::optional<double> max_false_accept;  // in place of min_probability
  std::optional<double> deadline_ms;
  std::optional<std::string> version;
  std::optional<Pose> T_odom_base{};  // of the base by odometry, at the scan's stamp; it changes no answer
  std::optional<Twist> twist{};  // of the sensor during the scan, whose points then need times
};

using Strings = std::vector<std::pair<std::string, std::string>>;

namespace detail {

// Comma-separated numbers in any locale, with enough digits to read the same double again.
inline std::string comma_separated(const std::vector<double>& numbers) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text.precision(17);
  const char* between = "";
  for (const double v : numbers) {
    if (!std::isfinite(v)) throw Error("invalid_option", "a number of an option is not finite");
    text << between << v;
    between = ",";
  }
  return text.str();
}

}  // namespace detail

// Names and values of the options as query parameters, not escaped. Throws "invalid_option" for a number that is not
// finite.
inline Strings strings_of(const LocalizeOptions& options) {
  Strings strings;
  const auto add = [&strings](const char* name, const std::vector<double>& numbers) {
    strings.emplace_back(name, detail::comma_separated(numbers));
  };
  if (options.gravity) add("gravity", {options.gravity->begin(), options.gravity->end()});
  if (options.prior) {
    const Prior& prior = *options.prior;
    std::vector<double> numbers{prior.position[0], prior.position[1], prior.position[2], prior.radius_m};
    if (prior.yaw_range_deg < 180) numbers.insert(numbers.end(), {prior.yaw_deg, prior.yaw_range_deg});
    add("prior", numbers);
  }
  const auto add_pose = [&add](const char* name, const Pose& given) {
    if (!detail::usable(given)) throw Error("invalid_option", std::string(name) + " is not a valid pose");
    const Pose pose = detail::normalised(given);
    std::vector<double> numbers(pose.position.begin(), pose.position.end());
    numbers.insert(numbers.end(), pose.quaternion.begin(), pose.quaternion.end());
    add(name, numbers);
  };
  if (options.T_base_sensor) add_pose("T_base_sensor", *options.T_base_sensor);
  if (options.T_odom_base) add_pose("T_odom_base", *options.T_odom_base);
  if (options.max_candidates) add("max_candidates", {static_cast<double>(*options.max_candidates)});
  if (options.min_probability) add("min_probability", {*options.min_probability});
  if (options.max_false_accept) add("max_false_accept", {*options.max_false_accept});
  if (options.deadline_ms) add("deadline_ms", {*options.deadline_ms});
  if (options.version) strings.emplace_back("version", *options.version);
  if (options.twist) {
    std::vector<double> numbers(options.twist->linear.begin(), options.twist->linear.end());
    numbers.insert(numbers.end(), options.twist->angular.begin(), options.twist->angular.end());
    add("twist", numbers);
  }
  return strings;
}

}  // namespace firstfix
