// Free space: rays and points of any kind, and tables that hold any numbers.
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "firstfix/verification/carved_cells.hpp"
#include "firstfix/verification/seen_free.hpp"
#include "hostile.hpp"
#include "random_grid.hpp"

namespace firstfix::tests {
namespace {

void carve_once(Hostile& random) {
  const double wrong = random.chance(0.3) ? 0.01 : 0, cell_m = std::pow(10.0, random.real(2, 0));
  const auto rays = static_cast<std::size_t>(random.number(0, 50)), points = static_cast<std::size_t>(random.number(0, 200));
  try {
    CarvedCells cells(cell_m);
    for (int pose = 0; pose < 3; ++pose) {
      const double origin[3] = {random.real(9, wrong), random.real(9, wrong), random.real(9, wrong)};
      const std::vector<float> directions = random.floats(3 * rays, 1, wrong), ranges = random.floats(rays, 20, 0.1);
      cells.add(origin, directions.data(), rays, ranges.data(), 0.3);
    }
    CarvedBricks found = cells.bricks();
    std::vector<double> near(3 * points);
    for (double& value : near) value = random.real(9, wrong);
    const std::vector<BrickBits> before = found.once;
    take_out_near(found.brick.data(), found.once.size(), near.data(), points, cell_m, found.once.data());
    for (std::size_t row = 0; row < before.size(); ++row) {
      for (std::size_t x = 0; x < 8; ++x) {
        expect((found.twice[row][x] & ~before[row][x]) == 0, "what is seen twice is seen once");
        expect((found.once[row][x] & ~before[row][x]) == 0, "points add nothing");
      }
    }
  } catch (const std::invalid_argument&) {  // not finite, or too many cells away
  }
}

void share_once(Hostile& random) {
  const double wrong = random.chance(0.5) ? 0.3 : 0;
  const std::int32_t shape[3] = {static_cast<std::int32_t>(random.number(1, 4)), static_cast<std::int32_t>(random.number(1, 4)),
                                 static_cast<std::int32_t>(random.number(1, 3))};
  const std::int64_t groups = random.number(1, 5), bricks = random.number(1, 30);
  const std::vector<std::int32_t> group = random.pointers(static_cast<std::size_t>(shape[0] * shape[1] * shape[2]), groups, wrong);
  const std::vector<std::int32_t> brick = random.pointers(static_cast<std::size_t>(groups) << 9, bricks, wrong);
  const std::vector<std::int32_t> bits = random.pointers(static_cast<std::size_t>(bricks) << 4, 1, 1);
  const SeenFree free{random.chance(0.1) ? 1e-30F : 0.2F, {-8, -8, -4}, group.data(), {shape[0], shape[1], shape[2]},
                      brick.data(), static_cast<std::uint32_t>(groups), bits.data(), static_cast<std::uint32_t>(bricks)};
  const auto count = static_cast<std::size_t>(random.number(0, 300));
  const std::vector<float> points = random.floats(3 * count, 20, wrong);
  const double share = free.share(points.data(), count, pose(random, wrong));
  expect(share >= 0 && share <= 1, "a share");
  std::vector<std::uint8_t> is_free(count);
  free.holds(points.data(), count, pose(random, wrong), is_free.data());
  for (const std::uint8_t one : is_free) expect(one <= 1, "a flag");
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 1500; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::carve_once(random);
    firstfix::tests::share_once(random);
  }
}
