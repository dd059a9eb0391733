// Surfaces of clouds of any shape. The binding refuses normals and weights that are none.
#include <cmath>
#include <stdexcept>
#include <vector>

#include "firstfix/mesh/by_first_use.hpp"
#include "firstfix/mesh/cell_planes.hpp"
#include "firstfix/mesh/in_sight.hpp"
#include "firstfix/mesh/surface_net.hpp"
#include "firstfix/mesh/with_neighbours.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

// Rows of numbers around zero, or around a place far off, with some that are no numbers.
std::vector<double> coordinates(Hostile& random, std::size_t count) {
  const double reach = std::pow(10.0, random.real(3, 0)), middle = random.chance(0.5) ? 0 : random.real(1e5, 0);
  std::vector<double> values(3 * count);
  const double wrong = random.chance(0.3) ? 0.01 : 0;
  for (double& value : values) value = middle + random.real(reach, wrong);
  if (random.chance(0.3)) {  // a plane
    for (std::size_t i = 2; i < values.size(); i += 3) values[i] = middle;
  }
  return values;
}

void try_surface(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 300));
  const std::vector<double> points = coordinates(random, count);
  const double cell_m = std::pow(10.0, random.real(3, 0));
  try {
    const CellPlanes planes = cell_planes(points.data(), count, cell_m);
    double held = 0;
    for (const double weight : planes.weights) held += weight;
    expect(held <= static_cast<double>(count), "every point is in one cell");
    for (std::size_t row = 0; row < planes.weights.size(); ++row) {
      expect(planes.supports[row] >= planes.weights[row], "the points of a cell are around it");
      expect(planes.best[row] >= planes.supports[row], "a cell is one of those around it");
    }
    const SurfaceNet net = surface_net(planes.means.data(), planes.normals.data(), planes.weights.data(),
                                       planes.weights.size(), points.data(), count, cell_m, 0.1 + 3.9 * std::fabs(random.real(1, 0)),
                                       0.1 + 3.9 * std::fabs(random.real(1, 0)));
    for (const double value : net.vertices) expect(std::isfinite(value), "a vertex is finite");
    for (const std::uint32_t corner : net.triangles) {
      expect(corner < net.vertices.size() / 3, "a triangle has vertices");
    }
  } catch (const std::invalid_argument&) {  // not finite, or too many cells away
  }
}

void try_sight(Hostile& random) {
  OccupiedVoxels voxels{nullptr, {}, {}, std::pow(10.0, random.real(3, 0))};
  std::size_t all = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    voxels.size[axis] = random.number(0, 12);
    voxels.low[axis] = random.number(0, 20) - 10;
    all *= static_cast<std::size_t>(voxels.size[axis]);
  }
  const std::vector<std::uint8_t> occupied(all, random.chance(0.5));
  voxels.occupied = occupied.data();
  const auto count = static_cast<std::size_t>(random.number(0, 60));
  const auto points = coordinates(random, count), outwards = coordinates(random, count), places = coordinates(random, count);
  std::vector<std::uint8_t> seen(count);
  in_sight(voxels, points.data(), outwards.data(), places.data(), count, random.real(3, 0), 16, seen.data());
  for (const std::uint8_t one : seen) expect(one <= 1, "a point is in sight or not");
}

void try_neighbours(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 300));
  std::vector<double> points = coordinates(random, count);
  for (double& value : points) {
    if (!std::isfinite(value)) value = 0;
  }
  const auto least = static_cast<std::size_t>(random.number(0, 5));
  std::vector<std::uint8_t> kept(count, 2);
  try {
    with_neighbours(points.data(), count, std::pow(10.0, random.real(3, 0)), least, kept.data());
  } catch (const std::invalid_argument&) {  // too far apart
    return;
  }
  for (const std::uint8_t one : kept) {
    expect(one <= 1, "a point is kept or not");
    expect(one == 0 || count > least, "a point is kept for its neighbours");
  }
}

void try_first_use(Hostile& random) {
  const auto vertices = static_cast<std::size_t>(random.number(1, 50)), tiles = static_cast<std::size_t>(random.number(0, 5));
  std::vector<std::int64_t> start{0}, triangles;
  for (std::size_t tile = 0; tile < tiles; ++tile) start.push_back(start.back() + random.number(0, 40));
  for (std::int64_t corner = 0; corner < 3 * start.back(); ++corner) {
    triangles.push_back(random.number(0, static_cast<std::int64_t>(vertices) - 1));
  }
  const VerticesByUse found = by_first_use(triangles.data(), start.data(), tiles, vertices);
  expect(found.vertex_start.size() == tiles + 1, "each tile begins somewhere");
  for (std::size_t corner = 0; corner < triangles.size(); ++corner) {
    const std::int64_t row = found.triangles[corner];
    expect(found.used[static_cast<std::size_t>(row)] == triangles[corner], "a corner stays the same vertex");
  }
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  firstfix::tests::Hostile random(18);
  for (int round = 0; round < 600; ++round) {
    firstfix::tests::try_surface(random);
    firstfix::tests::try_sight(random);
    firstfix::tests::try_first_use(random);
    firstfix::tests::try_neighbours(random);
  }
}
