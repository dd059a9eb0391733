// Alignment and free space on tables, scans and poses that hold any numbers.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "firstfix/registration/agreement.hpp"
#include "firstfix/registration/align.hpp"
#include "firstfix/registration/align_moving.hpp"
#include "firstfix/registration/covariance.hpp"
#include "firstfix/registration/distinct_poses.hpp"
#include "firstfix/registration/nearest_points.hpp"
#include "firstfix/registration/select_item.hpp"
#include "firstfix/verification/free_space.hpp"
#include "hostile.hpp"
#include "random_grid.hpp"

namespace firstfix::tests {
namespace {

void nearest_points_once(Hostile& random) {
  const RandomGrid tables(random, random.chance(0.5) ? 0.3 : 0);
  const auto count = static_cast<std::size_t>(random.number(0, 700));
  const std::int64_t first = random.number(0, 20), blocks = random.number(0, 30);
  std::vector<std::int32_t> cell(3 * count), row(count);
  for (std::int32_t& one : cell) {
    one = static_cast<std::int32_t>(random.chance(0.1) ? random.number(-2'000'000'000, 2'000'000'000) : random.number(-2, 90));
  }
  for (std::int32_t& one : row) one = static_cast<std::int32_t>(random.number(0, 2'000'000'000));
  std::vector<float> offset(3 * count);
  for (float& one : offset) one = static_cast<float>(random.number(0, 1000)) / 1000;
  const SurfaceGrid& grid = tables.grid;
  const GridBlocks part{grid.group, {grid.shape[0], grid.shape[1], grid.shape[2]}, grid.block, grid.groups, grid.side_bits,
                        grid.block_bits, first, blocks};
  const std::vector<std::int32_t> found = nearest_points(part, cell.data(), offset.data(), row.data(), count);
  expect(found.size() == static_cast<std::size_t>(blocks) << 3 * grid.block_bits, "a number for each cell");
  for (const std::int32_t one : found) expect(one >= -1, "a row or none");
}

bool are_numbers(const double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    if (!std::isfinite(values[i])) return false;
  }
  return true;
}

void align_once(Hostile& random) {
  const double wrong_tables = random.chance(0.5) ? 0.3 : 0, wrong_scan = random.chance(0.5) ? 0.05 : 0;
  const RandomGrid tables(random, wrong_tables);
  const auto count = static_cast<std::size_t>(random.number(0, 700));
  const std::vector<float> points = random.floats(3 * count, 4, wrong_scan);
  const std::vector<float> normals = random.floats(3 * count, 1, wrong_scan);
  std::vector<std::uint8_t> oriented(count);
  for (std::uint8_t& one : oriented) one = static_cast<std::uint8_t>(random.number(0, 2));
  const ScanSurface scan(vectors_of(points), vectors_of(normals), oriented.data());
  PairFinder finder(tables.grid, scan);
  const AlignParameters parameters{static_cast<int>(random.number(0, 12)), 0.5F, 0.06F};
  for (int repeat = 0; repeat < 3; ++repeat) {
    PoseMatrix T = pose(random, wrong_scan);
    Matrix6 information;
    const bool is_clean = are_numbers(T.data(), 16) && wrong_scan == 0;
    align(finder, count, parameters, T, information);
    const InlierShares quality = quality_at(finder, count, T, 0.15F);
    expect(quality.inlier_ratio >= 0 && quality.inlier_ratio <= 1, "inlier ratio within 0 and 1");
    expect(quality.alignment_score >= 0 && quality.alignment_score <= 1.00001, "alignment score within 0 and 1");
    const RandomGrid coarse(random, wrong_tables);
    const Agreement agreement = agreement_at(finder, coarse.grid, scan, T, 0.15F);
    expect(agreement.beside_surface >= 0 && agreement.beside_surface <= 1, "share beside a surface within 0 and 1");
    expect(agreement.same_plane >= 0 && agreement.same_plane <= 1, "chance of one plane within 0 and 1");
    const Matrix6 faced = faced_information(tables.grid, vectors_of(points), T, information, 0.5F);
    const Matrix6 covariance = pose_covariance(faced, T, 0.1);
    expect(!is_clean || wrong_tables != 0 || are_numbers(covariance.data(), 36), "a finite covariance");
    expect(free_axes(covariance, 0.2, 0.03).size() <= 6, "free directions");
    // damaged tables alone never make a pose that is no number
    expect(!is_clean || (are_numbers(T.data(), 16) && are_numbers(information.data(), 36)), "finite pose and information");
  }
}

void align_moving_once(Hostile& random) {
  const double wrong_tables = random.chance(0.5) ? 0.3 : 0, wrong_scan = random.chance(0.5) ? 0.05 : 0;
  const RandomGrid tables(random, wrong_tables);
  const auto count = static_cast<std::size_t>(random.number(0, 300));
  const std::vector<float> points = random.floats(3 * count, 4, wrong_scan);
  const std::vector<float> normals = random.floats(3 * count, 1, wrong_scan);
  std::vector<float> time_s = random.floats(count, 0.05, 0);
  if (random.chance(0.2)) {
    for (float& t : time_s) t = std::fmod(2000 * t, 100.0F);
  }
  const std::vector<std::uint8_t> oriented(count, 1);
  MovingScan scan(vectors_of(points), vectors_of(normals), oriented.data(), time_s.data());
  PairFinder finder(tables.grid, scan.seen());
  const Vector6 scale{1, 1, 1e-6, 1e-9, 1e9, 1};
  for (int repeat = 0; repeat < 2; ++repeat) {
    PoseMatrix T = pose(random, wrong_scan);
    Matrix6 information;
    Vector6 twist;
    for (double& one : twist) one = random.chance(0.5) ? 0 : random.floats(1, 20, 0)[0];
    const bool is_clean = are_numbers(T.data(), 16) && wrong_scan == 0;
    align_moving(finder, scan, {static_cast<int>(random.number(0, 12)), 0.5F, 0.06F}, scale, T, twist, information);
    const InlierShares quality = quality_at(finder, count, T, 0.15F);
    expect(quality.inlier_ratio >= 0 && quality.inlier_ratio <= 1, "inlier ratio within 0 and 1");
    expect(!is_clean || (are_numbers(T.data(), 16) && are_numbers(twist.data(), 6) && are_numbers(information.data(), 36)),
           "finite pose, twist and information");
  }
}

void look_once(Hostile& random) {
  const double wrong = random.chance(0.5) ? 0.3 : 0;
  const std::int64_t columns = random.number(0, 12), rows = random.number(0, 12), count = random.number(0, 3000);
  const std::vector<float> points = random.floats(static_cast<std::size_t>(3 * count), 25, wrong);
  const std::vector<std::int32_t> begin =
      random.pointers(static_cast<std::size_t>(columns * (rows + 1)), count, random.chance(0.5) ? 0.2 : 0);
  const std::vector<std::int32_t> low = random.pointers(2, 3, random.chance(0.2) ? 1 : 0);
  const PointTiles tiles{points.data(), count, begin.data(), columns, rows, {low[0] - (low[0] > 0 ? 6 : 0), low[1]}};
  std::vector<std::uint8_t> returned(kDirections);
  std::vector<float> least(kDirections, 5.0F);
  const std::int64_t lowest = random.number(0, kDirections - 1), highest = random.number(lowest, kDirections - 1);
  for (std::int64_t i = lowest; i <= highest; ++i) returned[i] = static_cast<std::uint8_t>(i % 3);
  const RandomGrid surface(random, wrong);
  const SeenThrough found =
      seen_through(tiles, tiles, random.chance(0.1) ? 200.0 : 25.0, surface.grid, returned.data(), least.data(),
                   pose(random, random.chance(0.5) ? 0.2 : 0));
  expect(found.onto_nothing >= 0 && found.onto_surface >= 0, "no share of directions below 0");
  expect(found.onto_nothing + found.onto_surface <= 1.00001, "shares of directions within 0 and 1");
}

// As std::nth_element, and with GNU's library, which is what is compiled with here, in the same places.
void select_once(Hostile& random) {
  struct Item {
    float number;
    std::int64_t row;
    bool operator==(const Item& other) const { return row == other.row; }
  };
  const std::int64_t count = random.number(1, random.chance(0.1) ? 3000 : 90), values = random.chance(0.3) ? 4 : 100'000;
  const bool is_unlucky = random.chance(0.2);  // the median of three is among the least again and again
  std::vector<Item> items;
  for (std::int64_t row = 0; row < count; ++row) {
    const std::int64_t half = count / 2;
    const std::int64_t killer = row >= half ? 2 * (row - half + 1) : row % 2 == 0 ? row + 1 : half + row;
    items.push_back({static_cast<float>(is_unlucky ? killer : random.number(0, values)), row});
  }
  std::vector<Item> wanted = items;
  const std::int64_t nth = random.number(0, count - 1);
  detail::select_item(items.data(), items.data() + nth, items.data() + count, [](const Item& item) { return item.number; });
  std::nth_element(wanted.begin(), wanted.begin() + nth, wanted.end(),
                   [](const Item& a, const Item& b) { return a.number < b.number; });
  for (std::int64_t i = 0; i < count; ++i) {
    const float here = items[static_cast<std::size_t>(i)].number, middle = items[static_cast<std::size_t>(nth)].number;
    expect(i < nth ? here <= middle : here >= middle, "lesser ones before, greater ones after");
  }
#ifdef __GLIBCXX__
  expect(items == wanted, "the places of std::nth_element");
#endif
}

void choose_once(Hostile& random) {
  std::vector<PoseMatrix> T;
  const auto count = static_cast<std::size_t>(random.number(0, 40)), most = static_cast<std::size_t>(random.number(0, 40));
  for (std::size_t i = 0; i < count; ++i) T.push_back(pose(random, 0.1));
  const std::vector<std::int64_t> kept = distinct_poses(T, 1.0, 0.26, most);
  expect(kept.size() <= std::min(count, most), "no more poses than asked for");
  for (std::size_t i = 0; i < kept.size(); ++i) expect(i == 0 || kept[i] > kept[i - 1], "ascending rows");
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 1500; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::align_once(random);
    firstfix::tests::nearest_points_once(random);
    firstfix::tests::align_moving_once(random);
    firstfix::tests::look_once(random);
    firstfix::tests::choose_once(random);
    firstfix::tests::select_once(random);
  }
}
