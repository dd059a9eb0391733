// Surfaces of clouds of any shape. The binding refuses normals and weights that are none.
#include <cmath>
#include <stdexcept>
#include <vector>

#include "firstfix/mesh/cell_planes.hpp"
#include "firstfix/mesh/surface_net.hpp"
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

}  // namespace
}  // namespace firstfix::tests

int main() {
  firstfix::tests::Hostile random(18);
  for (int round = 0; round < 600; ++round) firstfix::tests::try_surface(random);
}
