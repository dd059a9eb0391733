#include "viewpoint.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/query/scan_facts.hpp"
#include "firstfix/scan/range_view.hpp"

namespace firstfix::version {
namespace {

using Place = std::array<double, 3>;
using Counts = std::vector<std::int64_t>;

constexpr double kAwayM = 1.5;  // robots carry LiDARs so far from the frame of their scans

std::size_t directions(Vectors<const float> points, const Place& at) {
  return detail::directions_seen(points, {static_cast<float>(at[0]), static_cast<float>(at[1]), static_cast<float>(at[2])});
}

std::vector<float> at_most(Vectors<const float> points, std::size_t count) {
  std::vector<float> chosen(3 * std::min(points.size, count));
  chosen_by_chance(points.data, points.size, count, chosen.data());
  return chosen;
}

Vectors<const float> vectors_of(const std::vector<float>& numbers) { return {numbers.data(), numbers.size() / 3}; }

// Number of the points in each direction of the range view, seen from a place.
Counts density(Vectors<const float> points, const Place& at) {
  constexpr float kColumns = kViewColumns;
  Counts counts(kDirections);
  for (std::size_t i = 0; i < points.size; ++i) {
    const float x = points[i][0] - static_cast<float>(at[0]), y = points[i][1] - static_cast<float>(at[1]);
    const float z = points[i][2] - static_cast<float>(at[2]);
    const auto column = static_cast<std::size_t>((detail::atan2_turns(y, x) + 0.5F) * kColumns) % kViewColumns;
    const auto row = static_cast<std::size_t>((detail::atan2_turns(z, std::sqrt(x * x + y * y)) + 0.25F) * kColumns);
    ++counts[std::min(row, kViewRows - 1) * kViewColumns + column];
  }
  return counts;
}

double filled_share(const Counts& view) {
  constexpr std::size_t kCells = 3;  // of the range view: columns of 6 degrees
  std::vector<bool> filled(kViewColumns / kCells);
  for (std::size_t i = 0; i < view.size(); ++i) {
    if (view[i] > 0) filled[i % kViewColumns / kCells] = true;
  }
  return static_cast<double>(std::count(filled.begin(), filled.end(), true)) / static_cast<double>(filled.size());
}

Counts coarser(const Counts& view, std::size_t size) {
  Counts made(kDirections / (size * size));
  for (std::size_t i = 0; i < view.size(); ++i) {
    made[i / kViewColumns / size * (kViewColumns / size) + i % kViewColumns / size] += view[i];
  }
  return made;
}

std::int64_t filled(const Counts& view) {
  return std::count_if(view.begin(), view.end(), [](std::int64_t count) { return count > 0; });
}

// Of points in the directions that they fill. With p the chance that two share a direction, 1 / p even directions would give the same.
double evenness(const Counts& view) {
  std::int64_t points = 0, pairs = 0;
  for (const std::int64_t count : view) points += count, pairs += count * (count - 1);
  const auto all = static_cast<double>(points);
  const double shared = static_cast<double>(pairs) / (all * (all - 1));
  return 1 / (shared * static_cast<double>(filled(view)));
}

// Evenness of a view over that of the own one, in the finest directions that have enough points.
double evenness_ratio(const Counts& own_view, const Counts& view, std::size_t points) {
  constexpr std::int64_t kPointsACell = 8;  // with fewer, chance decides on how even they are
  for (const std::size_t size : {2, 3}) {   // directions of 4 degrees, and of 6 for fewer points
    const Counts own = coarser(own_view, size), other = coarser(view, size);
    if (static_cast<std::int64_t>(points) >= kPointsACell * std::max(filled(own), filled(other))) return evenness(other) / evenness(own);
  }
  return 1;
}

// Mean number of points in the occupied cells, of those whose range lies between two limits.
double points_a_cell(Vectors<const float> points, const std::vector<float>& range_m, double least_m, double most_m) {
  constexpr float kCellM = 0.25F;
  std::vector<std::int64_t> keys;
  for (std::size_t i = 0; i < points.size; ++i) {
    const auto range = static_cast<double>(range_m[i]);
    if (!(range >= least_m && range <= most_m)) continue;
    const auto cell = [&](std::size_t axis) { return static_cast<std::int64_t>(std::floor(points[i][axis] / kCellM)) + 1024; };
    keys.push_back(cell(0) * (1 << 22) | cell(1) * (1 << 11) | cell(2));
  }
  const auto count = static_cast<double>(keys.size());
  std::sort(keys.begin(), keys.end());
  return count / static_cast<double>(std::unique(keys.begin(), keys.end()) - keys.begin());
}

// Of ascending numbers, with a straight line between two of them.
double quantile(const std::vector<float>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1), below = std::floor(at), part = at - below;
  const auto number = static_cast<std::size_t>(below);
  const float low = sorted[number], high = sorted[std::min(number + 1, sorted.size() - 1)];
  const auto step = static_cast<double>(high - low);
  return part >= 0.5 ? static_cast<double>(high) - step * (1 - part) : static_cast<double>(low) + step * part;
}

}  // namespace

double Viewpoint::evidence() const { return spread_ratio * filled_share * std::max(evenness_ratio, 1.0); }

bool is_suspect(Vectors<const float> part) {
  constexpr double kSuspect = 1.06;  // directions from a probed place, against those from the origin
  constexpr double kProbeM = 4.0;    // from the origin, towards the middle of the points
  return is_spread_elsewhere(part, kSuspect, kProbeM);
}

Viewpoint best_viewpoint(Vectors<const float> points) {
  constexpr std::size_t kPoints = 2000, kWeighed = 20'000;
  constexpr double kRiseM = 1.0;  // the search does not leave the height of the origin further: from above, all is in view
  const std::vector<float> some = at_most(points, kPoints);
  const Vectors<const float> part = vectors_of(some);
  const std::array<float, 3> middle = detail::middle_of(part);
  const std::size_t own = directions(part, {0, 0, 0});
  using Seen = std::pair<std::size_t, Place>;
  const Place towards{static_cast<double>(middle[0]), static_cast<double>(middle[1]), 0};
  Seen best = std::max(Seen{own, {0, 0, 0}}, Seen{directions(part, towards), towards});
  for (const double step_m : {8.0, 4.0, 2.0, 1.0, 0.5}) {
    for (int round = 0; round < 6; ++round) {
      const Place at = best.second;
      std::vector<Place> tried;
      for (const double x : {-1.0, 0.0, 1.0}) {
        for (const double y : {-1.0, 0.0, 1.0}) {
          if (x != 0 || y != 0) tried.push_back({at[0] + step_m * x, at[1] + step_m * y, at[2]});
        }
      }
      for (const double rise_m : {-step_m, step_m}) {
        if (std::fabs(at[2] + rise_m) <= kRiseM) tried.push_back({at[0], at[1], at[2] + rise_m});
      }
      const std::size_t before = best.first;
      for (const Place& one : tried) {
        const std::size_t count = directions(part, one);
        if (count > best.first) best = {count, one};
      }
      if (best.first == before) break;
    }
  }
  const std::vector<float> weighed = at_most(points, kWeighed);
  const Counts own_view = density(vectors_of(weighed), {0, 0, 0}), view = density(vectors_of(weighed), best.second);
  return {best.second, static_cast<double>(best.first) / static_cast<double>(std::max<std::size_t>(own, 1)), filled_share(own_view),
          evenness_ratio(own_view, view, weighed.size() / 3)};
}

bool is_elsewhere(const Viewpoint& viewpoint, const PoseMatrix* T_map_sensor) {
  constexpr double kMore = 1.2;       // directions, against those from the origin: with fewer, none is better
  constexpr double kElsewhere = 1.1;  // evidence, where no pose is lost by it, or that of the map's own origin
  constexpr double kElsewhereDespitePose = 2.0;  // of right scans without a pose it is 1.6 at most
  const auto [x, y, z] = viewpoint.position_m;
  if (std::sqrt(x * x + y * y + z * z) <= kAwayM || viewpoint.spread_ratio <= kMore) return false;
  const bool is_free = T_map_sensor == nullptr || is_map_origin(*T_map_sensor);
  return viewpoint.evidence() > (is_free ? kElsewhere : kElsewhereDespitePose);
}

bool is_map_origin(const PoseMatrix& T) {
  constexpr double kSameM = 0.15, kSameDeg = 1.5;
  if (std::max({std::fabs(T[3]), std::fabs(T[7]), std::fabs(T[11])}) > kSameM) return false;
  return (T[0] + T[5] + T[10] - 1) / 2 > std::cos(kSameDeg * (detail::kPi / 180));
}

bool is_even(Vectors<const float> points) {
  constexpr std::size_t kMapPoints = 200'000;  // in range: fewer may be a terrestrial scan, which its scanner has thinned evenly
  constexpr double kEven = 2.0;  // points in a cell near the sensor over those in a cell far from it; raw scans have 3 to 22
  if (points.size < kMapPoints) return false;
  std::vector<float> range_m(points.size);
  for (std::size_t i = 0; i < points.size; ++i) {
    const float* p = points[i];
    range_m[i] = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
  }
  std::vector<float> sorted = range_m;
  std::sort(sorted.begin(), sorted.end());
  const auto between = [&](double least, double most) {
    return points_a_cell(points, range_m, quantile(sorted, least), quantile(sorted, most));
  };
  return between(0.1, 0.35) < kEven * between(0.75, 1.0);
}

}  // namespace firstfix::version
