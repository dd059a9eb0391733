// Scans of any numbers, prepared for a query.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include "firstfix/query/prepared_query.hpp"
#include "firstfix/query/scan_facts.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

std::vector<float> cloud(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 250));
  std::vector<float> points = random.floats(3 * count, random.chance(0.2) ? 1e3 : 9, random.chance(0.5) ? 0.02 : 0);
  if (random.chance(0.3)) {  // level ground
    for (std::size_t i = 2; i < points.size(); i += 3) points[i] = -1.5F;
  }
  return points;
}

std::vector<float> times(Hostile& random, std::size_t count) {
  std::vector<float> time_s(count);
  const double sweep_s = random.chance(0.3) ? 0.001 : 0.1;
  for (float& time : time_s) time = static_cast<float>(std::fabs(random.real(sweep_s, 0)));
  return time_s;
}

void check(const std::optional<PreparedScan>& made, const Preparation& wanted, std::size_t count) {
  if (!made) return;
  const std::size_t dense = made->dense.size(), sparse = made->sparse.size();
  expect(dense >= wanted.min_points && dense <= std::min(count, wanted.dense_points), "as many points as asked for");
  expect(sparse == 0 || sparse == wanted.sparse_points, "a part of the points, or none");
  expect(made->dense.normals.size() == 3 * dense && made->sparse.normals.size() == 3 * sparse, "a normal for each point");
  expect(made->view.returned.size() == kDirections && made->view.least_m.size() == kDirections, "a whole view");
  for (const float metres : made->dense.at.points) expect(std::fabs(metres) <= 200, "points within range");
  for (const auto& row : made->R_level_sensor) {
    for (const double part : row) expect(std::fabs(part) <= 1 + 1e-9, "a rotation");
  }
}

PoseMatrix moved(Hostile& random) { return {0, -1, 0, random.real(50, 0), 1, 0, 0, random.real(50, 0), 0, 0, 1, 0, 0, 0, 0, 1}; }

void join(const PreparedScan& made, const Preparation& wanted, Hostile& random) {
  const PoseMatrix T = moved(random);
  ScannedSurface untimed = made.dense;
  untimed.at.time_s.clear();
  const JoinedSurface both = joined({{T, &untimed}, {T, &made.dense}}, wanted.voxel_m, wanted.dense_points, wanted.sparse_points);
  const std::size_t all = 2 * made.dense.size();
  expect(both.dense.size() == std::min(all, wanted.dense_points) && both.sparse.size() == std::min(all, wanted.sparse_points),
         "as many points as asked for");
  expect(both.dense.normals.size() == 3 * both.dense.size(), "a normal for each point");
  expect(both.dense.at.time_s.size() == (made.dense.at.times() == nullptr ? 0 : both.dense.size()), "times for all, or for none");
}

void view_in_time(const std::vector<float>& points, const std::vector<float>& time_s, const std::vector<float>& nearest,
                  const std::vector<float>& directions) {
  const PointsInTime seen = timed_view(points.data(), time_s.data(), time_s.size(), nearest.data(), directions.data());
  expect(seen.size() == seen.time_s.size(), "a time for each return");
  for (const float time : seen.time_s) expect(std::fabs(time) <= 0.2F, "times of the scan");
}

// Whole and compact scans of the same points, one after the other.
void prepare_query(Vectors<const float> points, const float* time_s, const std::vector<float>& nearest, const Preparation& wanted,
                   Hostile& random) {
  std::vector<AskedScan> asked;
  for (std::int64_t i = random.number(1, 3); i > 0; --i) {
    AskedScan one{i == 1 ? detail::kSameFrame : moved(random), points, time_s, random.chance(0.5) ? nearest.data() : nullptr, {}};
    if (one.nearest_m != nullptr && random.chance(0.5)) {
      const LayeredGrid grid = LayeredGrid::of(4, 8, 20, {0.F, 1.F, 3.F});
      one.described = RobotDescription{grid, std::vector<std::uint8_t>(grid.bytes(), 3), {0, 0, 1}, 1.2};
    }
    asked.push_back(one);
  }
  SensorState sensor{std::nullopt, {0, 0.1, 0.9}, std::nullopt};
  if (random.chance(0.3)) sensor.gravity = detail::Vector3{0.1, 0, -9.8};
  if (random.chance(0.3)) sensor.twist = Vector6{random.real(5, 0), 0.1, 0, 0, 0, random.real(2, 0)};
  try {
    const auto query = PreparedQuery::of(asked, sensor, {wanted, 1, 0.9});
    if (!query) return;
    const LayeredGrid grid = LayeredGrid::of(4, 8, 20, {0.F, 1.F, 3.F});
    const std::vector<QueriedScan> scans = query->queried(&grid);
    expect(scans.size() == query->searched().scans.size() && !scans.empty(), "a view for each scan");
    for (const QueriedScan& one : scans) expect(one.measured.thinned.count >= wanted.min_points, "enough points");
    const SearchedQuery& searched = query->searched();
    expect((searched.sparse.size() == 0) == (searched.dense.size() == 0) && searched.spots >= 1, "a part of the points");
  } catch (const Error&) {
    expect(time_s == nullptr && sensor.twist.has_value(), "a twist needs times");
  }
}

void tell(Vectors<const float> points, Hostile& random) {
  if (points.size == 0 || !std::all_of(points.data, points.data + 3 * points.size, [](float m) { return std::isfinite(m); })) return;
  const PartFacts facts = scan_facts(points);
  expect(facts.median_range_m >= 0 && facts.median_range_m <= facts.largest_range_m, "ranges");
  expect(!facts.rings || (*facts.rings >= 1 && *facts.rings <= kMaxRings), "rings");
  expect(!facts.plane_ratio || *facts.plane_ratio >= 0, "a thickness");
  is_spread_elsewhere(points, random.real(2), 4);
}

void prepare_once(Hostile& random) {
  const std::vector<float> points = cloud(random);
  const std::size_t count = points.size() / 3;
  const std::vector<float> time_s = times(random, count);
  const auto most = [&] { return static_cast<std::size_t>(random.number(1, random.chance(0.5) ? 20 : 300)); };
  const Preparation wanted{std::fabs(random.real(2)), random.real(200, 0), random.chance(0.1) ? random.real(1, 0.3) : 0.3,
                           static_cast<std::size_t>(random.number(0, 12)), most(), most(), most(), most()};
  const Levelling levelling{{random.real(1, 0), random.real(1, 0), random.chance(0.1) ? -1.0 : 0.6}, random.chance(0.5),
                            std::nullopt, 1};
  const float* const when = random.chance(0.5) ? time_s.data() : nullptr;
  std::vector<float> nearest(kDirections, std::numeric_limits<float>::infinity()), directions(3 * kDirections, 0.5F);
  for (const float metres : random.floats(300, 60, 0.3)) {
    nearest[static_cast<std::size_t>(random.number(0, kDirections - 1))] = metres;
  }
  try {
    const auto made = prepared_scan(points.data(), when, count, wanted, levelling);
    check(made, wanted, count);
    if (made) join(*made, wanted, random);
    prepare_query({points.data(), count}, when, nearest, wanted, random);
    tell({points.data(), count}, random);
    view_in_time(points, time_s, nearest, directions);
    check(prepared_compact_scan(points.data(), when, count, nearest.data(), directions.data(), wanted, levelling), wanted,
          count);
  } catch (const std::invalid_argument&) {
    expect(!(wanted.voxel_m >= 1e-3), "points within range have voxels");
  }
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::prepare_once(random);
  }
}
