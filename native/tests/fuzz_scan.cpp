// Filters, levelling, views, normals and thinning on points that hold any numbers.
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "firstfix/registration/normals.hpp"
#include "firstfix/registration/thin_surface.hpp"
#include "firstfix/scan/flat_patches.hpp"
#include "firstfix/scan/levelling.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/scan/up_vote.hpp"
#include "firstfix/scan/voxel_filter.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

// Points of which some are equal, on a line, far away or no numbers.
std::vector<float> cloud(Hostile& random, double wrong) {
  const auto count = static_cast<std::size_t>(random.number(0, 90));
  std::vector<float> points = random.floats(3 * count, random.chance(0.2) ? 1e4 : 9, wrong);
  if (random.chance(0.2)) {
    for (std::size_t i = 0; i < points.size(); ++i) points[i] = i % 3 == 0 ? points[i] : 1;
  }
  if (random.chance(0.2)) {
    for (std::size_t i = 3; i < points.size(); ++i) points[i] = points[i % 3];
  }
  return points;
}

bool finite(const std::vector<float>& values) {
  for (const float value : values) {
    if (!std::isfinite(value)) return false;
  }
  return true;
}

// Runs what refuses points that are not finite or too far apart.
template <class Run>
void refused_or(bool usable, Run run) {
  bool refused = false;
  try {
    run();
  } catch (const std::invalid_argument&) {
    refused = true;
  }
  expect(!refused || !usable, "usable points are taken");
}

void filter_once(Hostile& random) {
  const std::vector<float> points = cloud(random, random.chance(0.5) ? 0.02 : 0);
  const std::size_t count = points.size() / 3;
  const double voxel_m = random.chance(0.2) ? random.real(1, 0.3) : 0.3;
  bool usable = finite(points) && voxel_m >= 1e-3;
  for (const float metres : points) usable = usable && std::fabs(metres) <= 1e4F;
  refused_or(usable, [&] {
    const std::vector<std::int64_t> rows = first_in_voxel(points.data(), count, voxel_m);
    for (std::size_t i = 1; i < rows.size(); ++i) expect(rows[i] > rows[i - 1], "ascending rows");
    const std::vector<double> means = voxel_means(points.data(), count, voxel_m, 0.0);
    expect(means.size() == 3 * rows.size(), "a mean for each voxel");
    const auto most = static_cast<std::size_t>(random.number(0, 200));
    const std::vector<std::int64_t> sample = rows_by_voxel_hash(points.data(), count, voxel_m, most);
    expect(sample.size() == std::min(count, most), "as many rows as asked for");
    for (const std::int64_t row : sample) expect(row >= 0 && static_cast<std::size_t>(row) < count, "a row of the points");
    const Patches flat = flat_patches(means.data(), rows.size(), 3 * voxel_m);
    expect(flat.points.size() == flat.normals.size() && flat.points.size() <= means.size(), "a normal for each point");
  });
  std::vector<float> kept(points.size());
  const std::size_t near = within_range(points.data(), count, random.real(9), random.real(90), kept.data());
  expect(near <= count, "no more points than there are");
  std::vector<float> nearest(kDirections, std::numeric_limits<float>::infinity()), least(kDirections);
  nearest_by_direction(points.data(), count, nearest.data());
  least_of_neighbours(nearest.data(), least.data());
  for (std::size_t i = 0; i < kDirections; ++i) expect(nearest[i] > 0.3F && least[i] <= nearest[i], "ranges");
  const auto most = static_cast<std::uint64_t>(random.number(0, 50));
  const auto all = static_cast<std::uint64_t>(random.number(0, 1 << 30));
  for (const std::int64_t row : detail::rows_by_chance(all, most)) {
    expect(row >= 0 && static_cast<std::uint64_t>(row) < all, "a row of the list");
  }
}

void level_once(Hostile& random) {
  const std::vector<float> points = cloud(random, 0.05);
  const std::size_t count = points.size() / 3;
  const std::vector<float> normals = random.floats(points.size(), 1, random.chance(0.5) ? 0.05 : 0);
  std::vector<double> R(9), directions(21);
  for (double& v : R) v = random.real(1);
  for (double& v : directions) v = random.real(1);
  std::vector<float> rotated(points.size());
  turned(points.data(), count, R.data(), rotated.data());
  const std::optional<double> height_m = floor_height(rotated.data(), normals.data(), count, 1000);
  expect(!height_m || (*height_m > 0 && *height_m <= 1000), "a height");
  std::vector<double> won(directions.size() / 3);
  votes(normals.data(), count, directions.data(), won.size(), won.data());
  refined_up(normals.data(), count, {directions[0], directions[1], directions[2]});
}

// The direction that is found by bounds on the votes has the most of all.
void vote_once(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.chance(0.2) ? random.number(0, 3000) : random.number(0, 60));
  const auto candidates = static_cast<std::size_t>(random.number(1, 40));
  const bool has_walls = random.chance(0.5);  // many normals along one axis, as in most places
  std::vector<double> normals;
  for (std::size_t i = 0; i < count; ++i) {
    detail::Vector3 normal{random.real(1, 0), random.real(1, 0), random.real(1, 0)};
    if (has_walls && random.chance(0.8)) normal[static_cast<std::size_t>(random.number(0, 2))] = random.chance(0.5) ? 30 : -30;
    const double length = std::sqrt(detail::dot(normal, normal));
    for (const double v : normal) normals.push_back(length > 0 ? v / length : 0);
  }
  std::vector<detail::Vector3> directions;
  std::vector<double> weights;
  for (std::size_t i = 0; i < candidates; ++i) {
    const bool is_again = i > 0 && random.chance(0.1);
    const double x = random.real(0.6, 0), y = random.real(0.6, 0);
    directions.push_back(is_again ? directions[i - 1] : detail::Vector3{x, y, std::sqrt(1 - x * x - y * y)});
    weights.push_back(is_again ? weights[i - 1] : 0.925 + random.real(0.075, 0));
  }
  const detail::Voters voters(normals.data(), count);
  std::size_t best = 0;
  for (std::size_t i = 1; i < candidates; ++i) {
    if (weights[i] * voters.votes_for(directions[i].data()) > weights[best] * voters.votes_for(directions[best].data())) best = i;
  }
  expect(voters.most_voted(directions, weights) == best, "the direction with the most votes, the first of equal ones");
}

void surface_once(Hostile& random) {
  std::vector<float> points = cloud(random, 0.02);
  const std::size_t count = points.size() / 3;
  std::vector<float> normals(points.size()), to_viewer = random.floats(points.size(), 9);
  std::vector<std::uint8_t> oriented(count);
  for (float& metres : points) metres = std::fabs(metres) <= 1e15F ? metres : 1e15F;  // as the border requires
  surface_normals(vectors_of(points), random.chance(0.5) ? to_viewer.data() : nullptr, random.chance(0.5), normals.data(),
                  oriented.data());
  for (std::size_t i = 0; i < normals.size(); i += 3) {
    const float length = std::hypot(normals[i], normals[i + 1], normals[i + 2]);
    expect(std::fabs(length - 1) < 1e-4F, "unit normals");
  }
  for (std::uint8_t& sure : oriented) sure = static_cast<std::uint8_t>(random.number(0, 255));
  refused_or(false, [&] {
    const ThinnedSurface thinned = thin_surface(vectors_of(points), vectors_of(to_viewer), oriented.data(), 0.5);
    expect(thinned.oriented.size() <= count && thinned.points.size() == 3 * thinned.oriented.size(), "fewer points");
  });
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::filter_once(random);
    firstfix::tests::level_once(random);
    firstfix::tests::vote_once(random);
    firstfix::tests::surface_once(random);
  }
}
