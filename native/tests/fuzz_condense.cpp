// From the returns of a scan to the bytes of a compact query, on numbers that no sensor gives.
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <vector>

#include "firstfix/scan/condense.hpp"
#include "firstfix/wire/compact_planes.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

DescriptorParameters parameters(Hostile& random) {
  DescriptorParameters made;
  if (random.chance(0.5)) made.max_range_m = random.chance(0.5) ? 1e4 : random.real(100, 0.3);
  if (random.chance(0.3)) made.min_range_m = random.real(5, 0.3);
  if (random.chance(0.3)) made.voxel_m = random.chance(0.5) ? 0.01 : random.real(10, 0.3);
  if (random.chance(0.2)) made.default_height_m = random.real(100, 0.3);
  if (random.chance(0.5)) {
    made.descriptor.emplace();
    if (random.chance(0.3)) made.descriptor->max_range_m = random.real(100, 0.3);
    if (random.chance(0.2)) made.descriptor->layer_edges_m = {random.real(9), random.real(9)};
  }
  return made;
}

// Where the points' voxels are, from the means themselves: one point in each, at most.
void check(const CompactScan& made, std::size_t most, const DescriptorParameters& used) {
  expect(made.points.size() <= most && made.nearest_m.size() == kDirections, "a compact scan has its size");
  expect(!made.time_s || made.time_s->size() == made.points.size(), "there is one time for each point");
  expect(made.described.has_value() == used.descriptor.has_value(), "a scan is described if it is asked for");
  for (const Point& point : made.points) expect(usable(point), "a point can be encoded");
  for (const float range_m : made.nearest_m) expect(range_m > 0, "a range is a number");
  if (made.described) expect(made.described->occupancy.size() == used.descriptor->bytes(), "the descriptor has its size");
  const CompactPlanes planes = compact_planes(numbers_of(made.points), made.points.size(), 0.02);
  expect(planes.order.size() == made.points.size(), "every point is encoded");
}

bool condense_any(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, random.chance(0.02) ? 60'000 : 400));
  const std::vector<float> points = random.floats(3 * count, random.chance(0.5) ? 1500 : 8, random.chance(0.5) ? 0.02 : 0);
  const std::vector<float> time_s = random.floats(count, 1, 0);
  const bool is_timed = random.chance(0.5) && count > 0;
  const auto most = static_cast<std::size_t>(random.number(0, 600));
  const DescriptorParameters used = parameters(random);
  std::optional<Gravity> gravity;
  if (random.chance(0.3)) gravity = Gravity{random.real(9.8), random.real(9.8), random.real(9.8)};
  const Returns returns{points.data(), is_timed ? time_s.data() : nullptr, count};
  try {
    const CompactScan made = condense(returns, used, gravity, most);
    check(made, most, used);
    // What the memory held before does not matter, nor whether it is kept.
    condense(Returns{points.data(), nullptr, count / 3}, {}, std::nullopt, 50);
    const CompactScan again = condense(returns, used, gravity, most);
    const auto numbers = [](const CompactScan& scan) {
      return std::vector<float>(numbers_of(scan.points), numbers_of(scan.points) + 3 * scan.points.size());
    };
    expect(numbers(again) == numbers(made) && again.nearest_m == made.nearest_m && again.time_s == made.time_s, "a scan gives one query");
    if (made.described) expect(again.described->occupancy == made.described->occupancy, "and one description");
    return true;
  } catch (const Error& error) {
    expect(error.code() == "invalid_option", "only options are refused");
  } catch (const std::invalid_argument&) {
    expect(false, "points within range have voxels");
  }
  return false;
}

// The sums by voxel against those of sorted points.
void sum_voxels(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(1, 500));
  const std::vector<float> points = random.floats(3 * count, random.chance(0.5) ? 3 : 900, 0), time_s = random.floats(count, 1, 0);
  const double voxel_m = random.chance(0.5) ? 0.3 : 0.01;
  detail::VoxelSums sums;
  const detail::VoxelMeans found = sums.means({points.data(), time_s.data(), count}, voxel_m);
  const TimedMeans wanted = timed_voxel_means(points.data(), time_s.data(), count, voxel_m, kBorderM);
  expect(std::vector<double>(found.points, found.points + 3 * found.count) == wanted.points, "the means are those of sorted points");
  expect(std::vector<double>(found.time_s, found.time_s + found.count) == wanted.time_s, "and their times");
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  using namespace firstfix::tests;
  Hostile random(1);
  int condensed = 0;
  constexpr int kRounds = 1500;
  for (int round = 0; round < kRounds; ++round) {
    condensed += condense_any(random);
    sum_voxels(random);
  }
  expect(condensed > kRounds / 4 && condensed < kRounds, "some scans are condensed, and some options are refused");
}
