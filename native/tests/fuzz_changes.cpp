// Comparison of scans with maps: tables, scans and poses that hold any numbers.
#include <cstdint>
#include <vector>

#include "firstfix/changes/cell_counts.hpp"
#include "firstfix/changes/compared.hpp"
#include "firstfix/changes/unexplained.hpp"
#include "hostile.hpp"
#include "random_grid.hpp"

namespace firstfix::tests {
namespace {

void compare_once(Hostile& random) {
  const double wrong = random.chance(0.5) ? 0.3 : 0;
  const std::int64_t columns = random.number(0, 12), rows = random.number(0, 12), count = random.number(0, 3000);
  const std::vector<float> points = random.floats(static_cast<std::size_t>(3 * count), 25, wrong);
  const std::vector<std::int32_t> begin =
      random.pointers(static_cast<std::size_t>(columns * (rows + 1)), count, random.chance(0.5) ? 0.2 : 0);
  const PointTiles tiles{points.data(), count, begin.data(), columns, rows, {-2, -2}};
  const auto returned = static_cast<std::size_t>(random.number(0, 500));
  const std::vector<float> returns = random.floats(3 * returned, 9, random.chance(0.5) ? 0.1 : 0);
  const PoseMatrix T = pose(random, random.chance(0.5) ? 0.2 : 0);
  ComparedPoints found;
  found.add(tiles, T, 0, 9);
  found.add(tiles, T, 9, 25);
  found.compare(vectors_of(returns), 2 * static_cast<std::int32_t>(random.number(2, 300)));
  for (std::size_t i = 0; i < found.size(); ++i) expect(!(found.gone[i] && found.met[i]), "seen through or met");

  const RandomGrid fine(random, wrong), coarse(random, wrong);
  const std::vector<float> around = random.floats(3 * static_cast<std::size_t>(random.number(0, 9)), 1, 0);
  std::vector<std::uint8_t> is_new(returned, 7);
  unexplained(vectors_of(returns), vectors_of(found.points), fine.grid, coarse.grid, T, vectors_of(around), vectors_of(around),
              25.0F, is_new.data());
  for (const std::uint8_t one : is_new) expect(one <= 1, "explained or not");
}

void count_once(Hostile& random) {
  const double wrong = random.chance(0.5) ? 0.3 : 0;
  const std::vector<float> turn = random.floats(9, 2, wrong), start = random.floats(3, 50, wrong);
  const auto size = static_cast<std::int32_t>(random.number(1, 60));
  CellCounts cube(turn.data(), start.data(), size);
  const std::vector<float> points = random.floats(3 * 200, 20, wrong), until_m = random.floats(200, 20, wrong);
  for (std::size_t i = 0; i < 200; ++i) {
    cube.add(&points[3 * i], static_cast<int>(i % 3));
    cube.add_ray(&points[3 * i], until_m[i], 0.5F, 3);
  }
  std::int32_t last = -1;
  cube.each([&](std::int32_t number, const CellCounts::Counts& counts) {
    expect(number > last && number < size * size * size, "ascending cells within the cube");
    expect(counts[0] + counts[1] + counts[2] + counts[3] > 0, "a cell that was counted");
    last = number;
  });
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 1500; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::compare_once(random);
    firstfix::tests::count_once(random);
  }
}
