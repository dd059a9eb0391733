#include "input_findings.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>

#include "finding_texts.hpp"
#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/query/scan_facts.hpp"
#include "firstfix/scan/points_in_time.hpp"

namespace firstfix::version {
namespace {

constexpr std::size_t kMeasured = 500;  // points

// Whether nearly all coordinates are whole numbers, of several values. Each decimetre counts once: a wall at a whole distance has
// many points, and says nothing.
bool has_whole_metres_only(const std::vector<float>& part, std::size_t axis) {
  constexpr std::size_t kLeastLevels = 10;  // of an intensity: fewer are chance
  constexpr double kWhole = 0.7;  // of the decimetres, the whole metres: intensities 0.97 at least, right scans 0.22 at most
  std::vector<float> decimetres;
  for (std::size_t i = axis; i < part.size(); i += 3) decimetres.push_back(std::nearbyint(part[i] * 10.0F));
  std::sort(decimetres.begin(), decimetres.end());
  decimetres.erase(std::unique(decimetres.begin(), decimetres.end()), decimetres.end());
  const auto whole = std::count_if(decimetres.begin(), decimetres.end(), [](float v) { return !(std::fabs(std::fmod(v, 10.0F)) > 0); });
  return decimetres.size() >= kLeastLevels && static_cast<double>(whole) / static_cast<double>(decimetres.size()) > kWhole;
}

// Whether x is an intensity or a ring: whole numbers, none below 0. A right scan whose x is never negative, because it looks forward
// only, has few whole numbers among them.
bool is_intensity_first(const std::vector<float>& part) {
  for (std::size_t i = 0; i < part.size(); i += 3) {
    if (static_cast<double>(part[i]) < -0.05) return false;  // as exact as a range image
  }
  return has_whole_metres_only(part, 0) && !has_whole_metres_only(part, 1);
}

// Whether points lie on the line x = y = z: by their distances from it over their ranges.
bool is_on_a_line(const std::vector<float>& part) {
  constexpr double kOffLine = 0.3;  // of points on a line; of right scans it is 0.4 at least, of arrays (3, n) 0.21 at most
  double squares = 0, off = 0;
  for (std::size_t i = 0; i < part.size(); i += 3) {
    const double x = static_cast<double>(part[i]), y = static_cast<double>(part[i + 1]), z = static_cast<double>(part[i + 2]);
    const double mean = (x + y + z) / 3;
    squares += x * x + y * y + z * z;
    off += (x - mean) * (x - mean) + (y - mean) * (y - mean) + (z - mean) * (z - mean);
  }
  return part.size() >= 3 * kMeasured && squares > 0 && std::sqrt(off / squares) < kOffLine;
}

// The cause why most points cannot be used, or nothing: they can, or the cause is not plain.
std::optional<Finding> by_ranges(const ScanFacts& facts, const Dropped& dropped) {
  constexpr double kMillimetresFromM = 2000, kCentimetresFromM = 150;  // LiDARs see 2 to 20 m in the median
  constexpr double kLargestM = 1e7;    // of millimetres, it would be 10 km: no unit makes ranges of it
  constexpr double kRobotM = 3;        // all points of a scan lie nearer: it shows the robot only, or the unit is wrong
  constexpr double kMapSpread = 0.2;   // of the points, against their distance: they are far from the origin, not from each other
  if (facts.points == 0) return found("scan_empty", {});
  const auto points = static_cast<double>(facts.points), in_range = static_cast<double>(facts.in_range);
  std::optional<double> median_m = facts.median_range_m;
  const std::optional<double> largest_m = facts.largest_range_m;
  if (largest_m && *largest_m > 0 && *largest_m < kRobotM) {
    return found("all_too_near", {{"points", points}, {"in_range", in_range}, {"largest_range_m", *largest_m}});
  }
  const auto finite = facts.points - static_cast<long long>(dropped.not_finite);
  if (2 * facts.in_range > finite && finite > 0) return std::nullopt;
  if (2 * static_cast<long long>(dropped.too_far) > finite) median_m = dropped.far_m;
  const long long zero = largest_m && !(*largest_m > 0) ? facts.valid : 0;
  if (!median_m || (zero > 0 && dropped.too_far == 0)) {
    return found("nothing_valid",
                 {{"points", points}, {"not_finite", static_cast<double>(dropped.not_finite)}, {"zero", static_cast<double>(zero)}});
  }
  std::map<std::string, double> numbers{{"points", points}, {"in_range", in_range}, {"median_range_m", *median_m}};
  const bool is_of_far = !(*median_m < dropped.far_m || *median_m > dropped.far_m);
  if (is_of_far && dropped.spread_m < kMapSpread * dropped.far_m) {
    numbers["spread_m"] = dropped.spread_m;
    return found("map_coordinates", numbers);
  }
  if (*median_m > kLargestM) return found("no_coordinates", numbers);
  if (*median_m > kMillimetresFromM) return found("unit_millimetres", numbers);
  if (*median_m > kCentimetresFromM) return found("unit_centimetres", numbers);
  return std::nullopt;
}

}  // namespace

LookedAt::LookedAt(const SentScan& scan) {
  if (scan.whole != nullptr) {
    const Scan usable = cleaned(*scan.whole);
    const std::vector<Point>& all = scan.whole->points;
    dropped = scan.whole->dropped;
    if (usable.points.size() < all.size()) {
      dropped = dropped_of(all.size(), [&all](std::size_t i) { return detail::vector_of(all[i]); });
    }
    points.assign(numbers_of(usable.points), numbers_of(usable.points) + 3 * usable.points.size());
    if (usable.time_s) time_s = *usable.time_s;
  } else {
    const CompactScan& compact = *scan.compact;
    points.assign(numbers_of(compact.points), numbers_of(compact.points) + 3 * compact.points.size());
    if (compact.time_s) time_s = *compact.time_s;
  }
  part.resize(3 * std::min(points.size() / 3, kMeasured));
  chosen_by_chance(points.data(), points.size() / 3, kMeasured, part.data());
}

ScanFacts facts_of(const LookedAt& scan, const Preparation& limits) {
  const std::size_t count = scan.points.size() / 3;
  ScanFacts made;
  made.points = static_cast<long long>(count + scan.dropped.points()), made.valid = static_cast<long long>(count);
  if (count == 0) {
    if (scan.dropped.too_far > 0) made.median_range_m = scan.dropped.far_m;
    return made;
  }
  made.in_range = static_cast<long long>(
      PointsInTime::within_range(scan.points.data(), nullptr, count, limits.min_range_m, limits.max_range_m).size());
  const PartFacts facts = scan_facts({scan.part.data(), scan.part.size() / 3});
  made.median_range_m = scan.dropped.too_far > count ? scan.dropped.far_m : static_cast<double>(facts.median_range_m);
  made.largest_range_m = static_cast<double>(facts.largest_range_m);
  if (facts.rings) made.rings = static_cast<long long>(*facts.rings);
  made.plane_ratio = facts.plane_ratio;
  if (!scan.time_s.empty()) {
    const auto [first, last] = std::minmax_element(scan.time_s.begin(), scan.time_s.end());
    made.time_span_s = static_cast<double>(*last - *first);
  }
  return made;
}

std::optional<Finding> input_finding(const ScanFacts& facts, const LookedAt& scan) {
  if (is_intensity_first(scan.part)) {  // before the units: intensities may be some hundred
    return found("columns_shifted", {}, {{"evidence", "the first has whole numbers, and none below 0"}});
  }
  auto cause = by_ranges(facts, scan.dropped);
  if (!cause && is_on_a_line(scan.part)) cause = found("transposed", {});
  return cause;
}

}  // namespace firstfix::version
