// Descriptor and search on points, bits and poses that hold any numbers, against plain computations.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/descriptor/best_shifts.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/descriptor/ring_spectra.hpp"
#include "firstfix/retrieval/nearest_in_lists.hpp"
#include "firstfix/retrieval/spread_out.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

constexpr std::array<std::size_t, 9> kSectors = {1, 7, 31, 60, 63, 64, 65, 128, 720};

std::size_t some_sectors(Hostile& random) {
  return kSectors[static_cast<std::size_t>(random.number(0, static_cast<std::int64_t>(kSectors.size()) - 1))];
}

// Each vector is as long as it must be, so that a read beyond it is found.
std::vector<std::uint8_t> some_bits(Hostile& random, std::size_t bytes) {
  std::vector<std::uint8_t> bits(bytes);
  const double filled = random.chance(0.2) ? 1 : 0.2;
  for (std::uint8_t& byte : bits) byte = random.chance(filled) ? static_cast<std::uint8_t>(random.number(0, 255)) : 0;
  return bits;
}

bool bit_of(const std::vector<std::uint8_t>& bits, std::size_t at) { return (bits[at / 8] >> (7 - at % 8) & 1) != 0; }

void describe_once(Hostile& random) {
  std::vector<float> edges_m = random.floats(static_cast<std::size_t>(random.number(2, 17)), 3, 0);
  std::sort(edges_m.begin(), edges_m.end());
  const double range_m = random.chance(0.1) ? 1e-44 : random.chance(0.1) ? 1e300 : 20;
  const LayeredGrid grid =
      LayeredGrid::of(static_cast<std::size_t>(random.number(1, 40)), some_sectors(random), range_m, edges_m);
  const double wrong = random.chance(0.5) ? 0.1 : 0;
  const auto scans = static_cast<std::size_t>(random.number(0, 3));
  std::vector<std::int64_t> start{0};
  for (std::size_t i = 0; i < scans; ++i) start.push_back(start.back() + random.number(0, 1100));
  const std::vector<float> points = random.floats(3 * static_cast<std::size_t>(start.back()), 10, wrong);
  const std::vector<float> height_m = random.floats(scans, 1, wrong);
  Rotation R{};
  for (float& v : R) v = static_cast<float>(random.real(1, wrong / 10));
  std::vector<std::uint8_t> bits(scans * grid.bytes());
  occupied_cells(points.data(), start.data(), height_m.data(), scans, random.chance(0.5) ? &R : nullptr, grid,
                 bits.data());
  for (std::size_t scan = 0; scan < scans; ++scan) {
    const auto count = static_cast<std::size_t>(start[scan + 1] - start[scan]);
    std::size_t filled = 0;
    for (std::size_t at = 0; at < 8 * grid.bytes(); ++at) filled += bit_of(bits, 8 * scan * grid.bytes() + at);
    expect(filled <= std::min(count, grid.cells()), "number of occupied cells");
  }
}

void compare_once(Hostile& random) {
  const auto rings = static_cast<std::size_t>(random.number(1, 30));
  const std::size_t sectors = some_sectors(random), cells = rings * sectors, bytes = (cells + 7) / 8;
  const std::vector<std::uint8_t> query = some_bits(random, bytes);
  const auto known = static_cast<std::size_t>(random.number(1, 12));
  const std::vector<std::uint8_t> templates = some_bits(random, known * bytes);
  std::vector<std::int64_t> rows(static_cast<std::size_t>(random.number(0, 20)));
  for (std::int64_t& row : rows) row = random.number(0, static_cast<std::int64_t>(known) - 1);
  std::vector<std::int64_t> shift(rows.size());
  std::vector<float> score(rows.size());
  BestShifts(query.data(), bytes, rings, sectors)
      .compare(templates.data(), rows.data(), rows.size(), shift.data(), score.data());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::size_t first = 8 * bytes * static_cast<std::size_t>(rows[i]);
    const auto shared_at = [&](std::size_t turn) {
      std::size_t shared = 0;
      for (std::size_t ring = 0; ring < rings; ++ring) {
        for (std::size_t s = 0; s < sectors; ++s) {
          shared += bit_of(query, ring * sectors + s) &&
                    bit_of(templates, first + ring * sectors + (s + turn) % sectors);
        }
      }
      return shared;
    };
    expect(0 <= shift[i] && static_cast<std::size_t>(shift[i]) < sectors, "shift");
    expect(score[i] >= 0 && score[i] <= 1.0001F, "score");
    const auto other = static_cast<std::size_t>(random.number(0, static_cast<std::int64_t>(sectors) - 1));
    const std::size_t best = shared_at(static_cast<std::size_t>(shift[i])), there = shared_at(other);
    expect(other < static_cast<std::size_t>(shift[i]) ? there < best : there <= best, "best shift");
  }
  RingSpectra spectra(rings, sectors, static_cast<std::size_t>(random.number(1, 40)));
  std::vector<float> key(spectra.size());
  spectra.key(query.data(), bytes, key.data());
  for (const float v : key) expect(v >= 0 && v <= 1.0001F, "key");
}

void choose_once(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 60)), most = static_cast<std::size_t>(random.number(0, 9));
  std::vector<double> position_m(3 * count), yaw_rad(count);
  for (double& v : position_m) v = random.real(4, 0.02);
  for (double& v : yaw_rad) v = random.real(4, 0.02);
  const Spot spot{2, 0.9, static_cast<std::size_t>(random.number(0, 3))};
  const std::vector<std::int64_t> chosen = spread_out(position_m.data(), yaw_rad.data(), count, most, spot);
  expect(chosen.size() <= std::min(count, most), "number of candidates");
  for (const std::int64_t row : chosen) expect(0 <= row && row < static_cast<std::int64_t>(count), "candidate");
}

void search_once(Hostile& random) {
  const auto known = static_cast<std::size_t>(random.number(1, 200)), numbers = static_cast<std::size_t>(random.number(0, 20)),
             lists = static_cast<std::size_t>(random.number(1, 6)), count = static_cast<std::size_t>(random.number(0, 12)),
             most = static_cast<std::size_t>(random.number(1, static_cast<std::int64_t>(known)));
  const std::vector<float> keys = random.floats(known * numbers, 4), queries = random.floats(count * numbers, 4);
  std::vector<std::int64_t> start(lists + 1), probed(2 * count), found(count * most);
  for (std::int64_t& begin : start) begin = random.number(0, static_cast<std::int64_t>(known));
  start.front() = 0, start.back() = static_cast<std::int64_t>(known);
  std::sort(start.begin(), start.end());
  for (std::int64_t& list : probed) list = random.number(0, static_cast<std::int64_t>(lists) - 1);
  nearest_in_lists({keys.data(), numbers, start.data(), lists}, queries.data(), count, probed.data(), 2, most, found.data());
  for (const std::int64_t key : found) expect(-1 <= key && key < static_cast<std::int64_t>(known), "key");
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    firstfix::tests::Hostile random(seed);
    firstfix::tests::describe_once(random);
    firstfix::tests::compare_once(random);
    firstfix::tests::choose_once(random);
    firstfix::tests::search_once(random);
  }
}
