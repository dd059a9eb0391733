// Rays, distances and seen surfaces on meshes of any shape. The binding refuses what is not finite or too far away.
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "firstfix/index/column_means.hpp"
#include "firstfix/index/seen_surface.hpp"
#include "firstfix/simulation/cast_cells.hpp"
#include "firstfix/simulation/cast_rays.hpp"
#include "firstfix/simulation/columns.hpp"
#include "firstfix/simulation/free_ways.hpp"
#include "firstfix/simulation/nearest_surface.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

// Numbers of any size that a mesh may have.
std::vector<float> coordinates(Hostile& random, std::size_t count) {
  const double reach = random.chance(0.5) ? 5 : std::pow(10.0, random.real(9, 0));
  std::vector<float> values = random.floats(count, reach, 0.05);
  for (float& value : values) {
    if (!(std::fabs(value) <= TriangleTree::kMostAway)) value = random.chance(0.5) ? 0 : TriangleTree::kMostAway;
  }
  if (random.chance(0.3)) {  // many in one place
    for (std::size_t i = 3; i < values.size() / 2; ++i) values[i] = values[i % 3];
  }
  return values;
}

void try_mesh(Hostile& random) {
  const auto vertices = static_cast<std::size_t>(random.number(1, 300));
  const auto count = static_cast<std::size_t>(random.number(1, 600));
  const std::vector<float> corners = coordinates(random, 3 * vertices);
  std::vector<std::uint32_t> triangles(3 * count);
  for (std::uint32_t& corner : triangles) {
    corner = static_cast<std::uint32_t>(random.number(0, static_cast<std::int64_t>(vertices) - 1));
  }
  const TriangleTree tree(corners.data(), triangles.data(), count);
  std::size_t held = 0;
  for (const TriangleTree::Leaf& leaf : tree.leaves()) held += static_cast<std::size_t>(leaf.count);
  expect(held == count, "every triangle is in one leaf");

  const auto rays = static_cast<std::size_t>(random.number(0, 60));
  const auto number = static_cast<std::size_t>(random.number(0, 20));
  std::vector<float> directions = random.floats(3 * rays, 1, 0);
  if (random.chance(0.2)) std::fill(directions.begin(), directions.end(), 0.0F);
  const std::vector<float> origins = coordinates(random, 3 * number);
  const std::vector<std::uint32_t> order = bundle_rays(vectors_of(directions));
  std::vector<float> ranges(number * rays, -1);
  cast_rays(tree, vectors_of(origins), vectors_of(directions), order.data(), 0.1F, 1e8F, ranges.data());
  for (const float range : ranges) expect(range >= 0.1F, "a range is within the limits or infinite");
  if (number) {
    std::vector<float> beyond = random.floats(rays, 5, 0), further(rays, -1);
    for (float& range : beyond) range = std::fabs(range);
    cast_rays_beyond(tree, origins.data(), vectors_of(directions), order.data(), beyond.data(), 1e8F, further.data());
    for (std::size_t i = 0; i < rays; ++i) expect(further[i] > beyond[i], "a range is beyond the one given");
  }
  const LayeredGrid grid = LayeredGrid::of(static_cast<std::size_t>(random.number(1, 9)),
                                           static_cast<std::size_t>(random.number(1, 9)), 30, {0.3F, 1, 4});
  std::vector<float> height_m = random.floats(number, 5, 0);
  std::vector<std::uint8_t> bits(number * grid.bytes());
  cast_cells(tree, vectors_of(origins), height_m.data(), vectors_of(directions), order.data(), 0.1F, 1e8F, grid,
             bits.data());
  std::vector<Crossing> crossings;
  for (std::size_t i = 0; i < number; ++i) {
    is_near_surface(tree, &origins[3 * i], 3);
    is_way_free(tree, &origins[3 * i], &origins[3 * (number - 1 - i)]);
    const double x = static_cast<double>(origins[3 * i]), y = static_cast<double>(origins[3 * i + 1]);
    cross_column(tree, x, y, 0.02, 5, crossings);
    expect(crossings.size() <= 5, "a column has no more surfaces than asked for");
    for (const Crossing& one : crossings) expect(std::isfinite(one.z), "a height is a number");
  }
  SeenSurface seen(std::pow(10.0, random.real(3, 0)));
  try {
    seen.add(origins.data(), number, directions.data(), rays, ranges.data());
  } catch (const std::invalid_argument&) {  // too far from the frame's origin
  }
  for (const double mean : seen.means()) expect(std::isfinite(mean), "a mean is a number");
}

void try_table(Hostile& random) {
  const auto rows = static_cast<std::size_t>(random.number(0, 200)), columns = static_cast<std::size_t>(random.number(3, 6));
  std::vector<double> table(rows * columns);
  for (double& value : table) value = random.real(10, 0.001);
  try {
    column_means(table.data(), rows, columns, std::pow(10.0, random.real(4, 0)));
  } catch (const std::invalid_argument&) {
  }
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  firstfix::tests::Hostile random(16);
  for (int round = 0; round < 400; ++round) {
    firstfix::tests::try_mesh(random);
    firstfix::tests::try_table(random);
  }
}
