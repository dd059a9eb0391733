#include "other_forms.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <utility>

#include "finding_texts.hpp"
#include "firstfix/bit_exact/atan2.hpp"

namespace firstfix::version {
namespace {

constexpr const char* kFits = "with them the scan fits (inliers {inlier_ratio:.2f} against {inlier_ratio_as_sent:.2f})";

struct Scale {
  double factor;
  const char* unit;  // that it is of, or ""
};
constexpr Scale kUsualScales[] = {{0.3048, "feet"}, {1 / 1.1, ""}, {1.1, ""}, {0.95, ""}, {1.05, ""}, {0.1, "decimetres"}, {0.0254, "inches"}};

// Factors to try: by the sensor's height, then usual ones.
std::vector<Scale> scales(double height_m, double usual_height_m) {
  constexpr double kLeast = 0.01, kMost = 100, kSame = 0.03;
  double by_height = 1;
  if (height_m > 0 && usual_height_m > 0) by_height = usual_height_m / height_m;  // a sensor may stand on the floor
  std::vector<Scale> wanted;
  for (const Scale& one : kUsualScales) {
    if (std::fabs(one.factor - by_height) < kSame * by_height) wanted.push_back(one);
  }
  if (wanted.empty()) wanted.push_back({by_height, ""});
  wanted.insert(wanted.end(), std::begin(kUsualScales), std::end(kUsualScales));
  std::vector<double> tried{1};
  std::vector<Scale> made;
  for (const Scale& one : wanted) {
    const bool is_new = std::all_of(tried.begin(), tried.end(), [&one](double other) { return std::fabs(one.factor / other - 1) > kSame; });
    if (!is_new || !(one.factor > kLeast && one.factor < kMost)) continue;
    tried.push_back(one.factor), made.push_back(one);
  }
  return made;
}

Scan multiplied(const Scan& scan, float x, float y, float z) {
  Scan made;
  made.points.reserve(scan.points.size());
  for (const Point& p : scan.points) made.points.push_back({p.x * x, p.y * y, p.z * z});
  return made;
}

// Points of ranges, azimuths and elevations; whether the numbers can be such.
bool is_polar(const Scan& scan, bool& is_in_degrees) {
  if (scan.points.empty()) return false;
  float least_m = scan.points.front().x, azimuth = 0, elevation = 0;
  for (const Point& p : scan.points) {
    least_m = std::min(least_m, p.x), azimuth = std::max(azimuth, std::fabs(p.y)), elevation = std::max(elevation, std::fabs(p.z));
  }
  const auto across = static_cast<double>(azimuth), up = static_cast<double>(elevation);
  is_in_degrees = across > 2 * detail::kPi + 0.01 || up > detail::kPi / 2 + 0.01;
  return !(least_m < 0 || across > 360 || up > 90);
}

Scan from_polar(const Scan& scan, bool is_in_degrees) {
  const double radians = is_in_degrees ? detail::kPi / 180 : 1;
  Scan made;
  made.points.reserve(scan.points.size());
  for (const Point& p : scan.points) {
    const double range_m = static_cast<double>(p.x), azimuth = static_cast<double>(p.y) * radians, up = static_cast<double>(p.z) * radians;
    const double level_m = range_m * std::cos(up);
    made.points.push_back({static_cast<float>(level_m * std::cos(azimuth)), static_cast<float>(level_m * std::sin(azimuth)),
                           static_cast<float>(range_m * std::sin(up))});
  }
  return made;
}

Scan with_columns_shifted(const Scan& scan) {
  Scan made;
  for (std::size_t i = 0; i < scan.points.size(); ++i) made.points.push_back({scan.points[i].y, scan.points[i].z, (*scan.intensity)[i]});
  return made;
}

void add_without_options(std::vector<OtherForm>& forms, const Scan& scan, const LocalizeOptions& options) {
  const auto as_sent = [&scan] { return scan; };
  if (options.gravity) {
    const auto by_gravity = [down = *options.gravity](const PoseMatrix& T, Numbers numbers) {
      const double cosine = -T[8] * down[0] - T[9] * down[1] - T[10] * down[2];
      const double off_deg = std::acos(std::min(std::max(cosine, -1.0), 1.0)) * (180 / detail::kPi);
      numbers["off_deg"] = off_deg;
      return found(off_deg > 135 ? "gravity_sign" : "gravity_wrong", numbers);
    };
    LocalizeOptions turned = options, without = options;
    for (double& one : *turned.gravity) one = -one;
    without.gravity.reset();
    forms.push_back({as_sent, turned, by_gravity}), forms.push_back({as_sent, without, by_gravity});
  }
  if (options.prior) {
    LocalizeOptions without = options;
    without.prior.reset();
    forms.push_back({as_sent, without, [at = options.prior->position](const PoseMatrix& T, Numbers numbers) {
                       const double x = T[3] - at[0], y = T[7] - at[1], z = T[11] - at[2];
                       numbers["distance_m"] = std::sqrt(x * x + y * y + z * z);
                       return found("prior_wrong", numbers);
                     }});
  }
}

void add_columns(std::vector<OtherForm>& forms, const Scan& scan, const LocalizeOptions& options) {
  if (scan.intensity && !scan.intensity->empty()) {
    const auto [least, most] = std::minmax_element(scan.intensity->begin(), scan.intensity->end());
    if (*most - *least > 0) {
      forms.push_back({[&scan] { return with_columns_shifted(scan); }, options, [](const PoseMatrix&, const Numbers& numbers) {
                         return found("columns_shifted", numbers, {{"evidence", filled(kFits, numbers)}});
                       }});
    }
  }
  bool is_in_degrees = false;
  if (!is_polar(scan, is_in_degrees)) return;
  forms.push_back({[&scan, is_in_degrees] { return from_polar(scan, is_in_degrees); }, options,
                   [](const PoseMatrix&, const Numbers& numbers) { return found("polar", numbers); }});
}

}  // namespace

std::vector<OtherForm> other_forms(const Scan& scan, const LocalizeOptions& options, double height_m, double usual_height_m) {
  std::vector<OtherForm> forms;
  add_without_options(forms, scan, options);
  LocalizeOptions free = options;
  free.prior.reset(), free.twist.reset();  // the forms below have no times of their points
  add_columns(forms, scan, free);
  for (const bool is_upright : {true, false}) {
    const float y = is_upright ? -1.0F : 1.0F;
    forms.push_back({[&scan, y] { return multiplied(scan, 1, y, -y); }, free, [is_upright](const PoseMatrix&, const Numbers& numbers) {
                       return found("mirrored", numbers, {{"axis", is_upright ? "y" : "z"}});
                     }});
  }
  for (const Scale& scale : scales(height_m, usual_height_m)) {
    const std::string unit = scale.unit[0] == 0 ? "" : std::string(", as from ") + scale.unit;
    const auto factor = static_cast<float>(scale.factor);
    forms.push_back({[&scan, factor] { return multiplied(scan, factor, factor, factor); }, free,
                     [by = scale.factor, unit](const PoseMatrix&, Numbers numbers) {
                       numbers["scale"] = by;
                       return found("scaled", numbers, {{"unit", unit}});
                     }});
  }
  return forms;
}

}  // namespace firstfix::version
