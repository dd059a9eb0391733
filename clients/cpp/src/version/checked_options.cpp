#include "checked_options.hpp"

#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/scan/deskew.hpp"
#include "number_text.hpp"

namespace firstfix::version {
namespace {

constexpr double kMaxNumber = 1e9;  // metres or degrees; more means nothing
constexpr double kMaxRadiusM = 1e6, kLongestMs = 600'000, kMostCandidates = 100;

void require(bool holds, const std::string& message) {
  if (!holds) throw Error("invalid_option", message);
}

// The numbers of an option. counts: how many there may be, as the message says it.
void check_size(const char* name, const char* counts, const std::vector<double>& numbers) {
  constexpr std::size_t kLongestText = 80;
  bool are_sane = true;
  std::string text;
  for (const double number : numbers) {
    are_sane = are_sane && std::fabs(number) <= kMaxNumber;  // not a number is not
    text += (text.empty() ? "" : ",") + number_text(number);
  }
  require(are_sane, std::string(name) + " is " + counts + " numbers separated by commas, not '" + text.substr(0, kLongestText) + "'");
}

void check_limits(const char* name, double number, double low, double high) {
  check_size(name, "1", {number});
  const auto whole = [](double limit) { return std::to_string(static_cast<long>(limit)); };
  require(number >= low && number <= high,
          std::string(name) + " must lie in [" + whole(low) + ", " + whole(high) + "], not " + number_text(number));
}

std::array<double, 3> direction(const std::array<double, 3>& down) {
  check_size("gravity", "2 or 3", {down.begin(), down.end()});
  const double length = std::sqrt(down[0] * down[0] + down[1] * down[1] + down[2] * down[2]);
  require(!(length < 1e-6), "gravity has no direction");
  return {down[0] / length, down[1] / length, down[2] / length};
}

void check_prior(const Prior& prior) {
  std::vector<double> numbers{prior.position[0], prior.position[1], prior.position[2], prior.radius_m};
  if (!(prior.yaw_range_deg >= 180)) numbers.insert(numbers.end(), {prior.yaw_deg, prior.yaw_range_deg});
  check_size("prior", "4 or 6", numbers);
  require(prior.radius_m > 0 && prior.radius_m <= kMaxRadiusM,
          "prior: radius_m must lie in (0, 1e+06], not " + number_text(prior.radius_m));
  require(prior.yaw_range_deg > 0 && prior.yaw_range_deg <= 180,
          "prior: yaw_range_deg must lie in (0, 180], not " + number_text(prior.yaw_range_deg));
  require(std::fabs(prior.yaw_deg) <= kMaxNumber, "prior: yaw_deg is out of range");  // with any heading allowed
}

Pose rigid(const char* name, const Pose& pose) {
  const auto& [position, turn] = pose;
  check_size(name, "7", {position[0], position[1], position[2], turn[0], turn[1], turn[2], turn[3]});
  const double length = std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2] + turn[3] * turn[3]);
  require(!(length < 1e-9), std::string(name) + ": the quaternion has no direction");
  return detail::normalised(pose);
}

void check_twist(const Twist& twist) {
  const auto& [linear, angular] = twist;
  check_size("twist", "6", {linear[0], linear[1], linear[2], angular[0], angular[1], angular[2]});
  for (std::size_t axis = 0; axis < 3; ++axis) {
    require(std::fabs(linear[axis]) <= kMaxLinearMS && std::fabs(angular[axis]) <= kMaxAngularRadS,
            "twist: at most 100 m/s and 20 rad/s along each axis");
  }
}

template <class Options>
void check_scene(Options& options) {
  if (options.gravity) options.gravity = direction(*options.gravity);
  if (options.prior) check_prior(*options.prior);
  if (options.T_base_sensor) options.T_base_sensor = rigid("T_base_sensor", *options.T_base_sensor);
}

}  // namespace

LocalizeOptions checked(const LocalizeOptions& options) {
  LocalizeOptions made = options;
  check_scene(made);
  if (made.T_odom_base) made.T_odom_base = rigid("T_odom_base", *made.T_odom_base);
  if (made.max_candidates) check_limits("max_candidates", *made.max_candidates, 1, kMostCandidates);
  if (made.min_probability) check_limits("min_probability", *made.min_probability, 0, 1);
  require(!made.min_probability || !made.max_false_accept, "min_probability and max_false_accept both set the threshold: give one");
  if (made.max_false_accept) check_limits("max_false_accept", *made.max_false_accept, 0, 1);
  if (made.deadline_ms) check_limits("deadline_ms", *made.deadline_ms, 1, kLongestMs);
  if (made.twist) check_twist(*made.twist);
  return made;
}

PlacesOptions checked(const PlacesOptions& options) {
  PlacesOptions made = options;
  check_scene(made);
  if (made.max_places) check_limits("max_places", static_cast<double>(*made.max_places), 1, kMostCandidates);
  return made;
}

}  // namespace firstfix::version
