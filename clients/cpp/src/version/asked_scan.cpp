#include "asked_scan.hpp"

#include <array>
#include <cmath>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/deskew.hpp"

namespace firstfix::version {
namespace {

Vector6 motion_of(const Twist& twist) {
  Vector6 motion;
  for (std::size_t k = 0; k < 3; ++k) {
    motion[k] = twist.linear[k], motion[3 + k] = twist.angular[k];
  }
  return motion;
}

// Up in the sensor frame: the opposite of gravity, or where it is expected.
Levelling levelling_of(const PlacesOptions& options, double default_height_m) {
  if (options.gravity) {
    const detail::Vector3& down = *options.gravity;
    return {{-down[0], -down[1], -down[2]}, true, std::nullopt, default_height_m};
  }
  return {up_by_mounting(options.T_base_sensor), false, std::nullopt, default_height_m};
}

}  // namespace

detail::Vector3 up_by_mounting(const std::optional<Pose>& T_base_sensor) {
  if (!T_base_sensor) return {0, 0, 1};
  const auto [x, y, z, w] = detail::normalised(*T_base_sensor).quaternion;
  return {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
}

std::optional<PreparedScan> prepared(const Scan& scan, const PlacesOptions& options, const EngineNumbers& numbers,
                                     const std::optional<Twist>& twist) {
  if (twist && !scan.time_s) throw Error("invalid_option", "a twist needs the times of the scan's points");
  if (scan.points.size() > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
  const Scan usable = cleaned(scan);
  const std::size_t count = usable.points.size();
  const float* points = numbers_of(usable.points);
  const float* time_s = usable.time_s ? usable.time_s->data() : nullptr;
  for (std::size_t i = 0; time_s != nullptr && i < count; ++i) {
    if (!(std::fabs(static_cast<double>(time_s[i])) <= kMaxAbsTime)) throw Error("invalid_scan", "a time is over 1 s from the stamp, or not a number");
  }
  std::vector<float> at_stamp;
  if (twist) {
    at_stamp.resize(3 * count);
    deskew({points, count}, time_s, motion_of(*twist), at_stamp.data());
    points = at_stamp.data(), time_s = nullptr;
  }
  return prepared_scan(points, time_s, count, numbers.preparation, levelling_of(options, numbers.default_height_m));
}

}  // namespace firstfix::version
