// Searches of retrieval tables of any numbers.
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "firstfix/retrieval/candidates.hpp"
#include "firstfix/retrieval/cascade.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

// Ascending from 0 to count, unless something is wrong.
std::vector<std::int32_t> starts(Hostile& random, std::size_t size, std::int64_t count, double wrong) {
  std::vector<std::int32_t> values(size);
  const auto last = static_cast<std::int64_t>(size) - 1;
  for (std::int64_t i = 0; i <= last; ++i) values[static_cast<std::size_t>(i)] = static_cast<std::int32_t>(count * i / last);
  if (random.chance(wrong)) {
    values[static_cast<std::size_t>(random.number(0, last))] = static_cast<std::int32_t>(random.number(-9, 90));
  }
  return values;
}

std::vector<std::int32_t> rows(Hostile& random, std::size_t size, std::int64_t count, double wrong) {
  std::vector<std::int32_t> values(size);
  for (auto& value : values) value = static_cast<std::int32_t>(random.number(0, count - 1));
  if (random.chance(wrong)) values[0] = static_cast<std::int32_t>(random.number(-3, 2 * count));
  return values;
}

void check(const Matches& found, std::size_t templates) {
  expect(found.rows.size() == found.score.size() && found.rows.size() == found.yaw_rad.size(), "one number a match");
  for (const auto row : found.rows) expect(row >= 0 && static_cast<std::size_t>(row) < templates, "rows of templates");
}

void search_once(Hostile& random) {
  const auto some = [&](std::int64_t most) { return static_cast<std::size_t>(random.number(1, most)); };
  const std::size_t templates = some(60), clusters = some(20), rings = some(9), sectors = some(70), columns = some(4),
                    tile_rows = some(4);
  const auto count = static_cast<std::int64_t>(templates);
  const double wrong = 0.05;
  Cascade cascade;
  std::vector<std::uint8_t> occupancy((rings * sectors + 7) / 8 * templates);
  for (auto& byte : occupancy) byte = static_cast<std::uint8_t>(random.number(0, 255));
  const std::vector<float> position_m = random.floats(3 * templates, 20), height_m = random.floats(templates, 3);
  const auto representative = rows(random, clusters, count, wrong), member = rows(random, templates, count, wrong),
             tile_row = rows(random, templates, count, wrong), start = starts(random, clusters + 1, count, wrong);
  std::vector<std::int32_t> begin;
  for (std::size_t column = 0; column < columns; ++column) {
    const auto of_column = starts(random, tile_rows + 1, count, wrong);
    begin.insert(begin.end(), of_column.begin(), of_column.end());
  }
  cascade.templates = {occupancy.data(), templates, rings, sectors};
  cascade.position_m = position_m.data();
  cascade.tiles = {tile_row.data(), begin.data(), columns, tile_rows, {static_cast<std::int32_t>(random.number(-4, 1)), 0}};
  cascade.clusters = {representative.data(), start.data(), member.data(), clusters};
  cascade.form.coefficients = some(40);
  const std::size_t spectra = rings * std::min(cascade.form.coefficients, sectors / 2 + 1);
  const bool projects = random.chance(0.5);
  const std::size_t numbers = projects ? some(40) : spectra;
  const std::vector<float> projection = random.floats(spectra * numbers, 1), lowest = random.floats(numbers, 1),
                           range = random.floats(numbers, 1);
  if (projects) cascade.form.projection = projection.data(), cascade.form.columns = numbers;
  std::vector<std::uint8_t> codes(clusters * numbers);
  for (auto& byte : codes) byte = static_cast<std::uint8_t>(random.number(0, 255));
  cascade.keys = {codes.data(), clusters, numbers, lowest.data(), range.data()};
  try {
    cascade.check();
  } catch (const std::invalid_argument&) {
    return;
  }
  const auto most = static_cast<std::size_t>(random.number(0, 30));
  const Matches found = cascade.search(occupancy.data(), most);
  check(found, templates);
  const detail::Vector3 centre{random.real(20), random.real(20), random.real(3)};
  check(cascade.search_near(occupancy.data(), centre, random.real(40), most), templates);
  LevelledFrame scan{{}, random.real(3), {}};
  HeadingPrior prior{{}, random.real(180), random.real(180)};
  for (auto& row : scan.R_level_sensor) row = {random.real(1), random.real(1), random.real(1)};
  for (double& number : scan.T_scan_last) number = random.real(1);
  for (double& number : prior.T_map_level) number = random.real(1);
  const Spot spot{2, 0.9, 2};
  const HeadingPrior* headings = random.chance(0.5) ? &prior : nullptr;
  const Candidates made = candidates_of(found, position_m.data(), height_m.data(), scan, headings, most,
                                        random.chance(0.5) ? &spot : nullptr);
  expect(made.templates.size() <= most && made.T_level_sensor.size() == made.score.size(), "not too many candidates");
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::search_once(random);
  }
}
