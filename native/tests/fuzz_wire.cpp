// Decoders of scans on bytes that nobody encoded. Each buffer is as long as the decoder may read, to the byte.
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/scan/usable_points.hpp"
#include "firstfix/wire/compact_planes.hpp"
#include "firstfix/wire/compact_points.hpp"
#include "firstfix/wire/planes.hpp"
#include "firstfix/wire/range_image_points.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

using Octets = std::vector<std::uint8_t>;

Octets octets(Hostile& random, std::size_t count) {
  // Now and then mostly zeros, or mostly escape values: those lead to other branches.
  const double zeros = random.chance(0.3) ? 0.9 : 0.1, ones = random.chance(0.2) ? 0.9 : 0.1;
  Octets made(count);
  for (std::uint8_t& one : made) {
    one = random.chance(zeros) ? 0 : random.chance(ones) ? 255 : static_cast<std::uint8_t>(random.number(0, 255));
  }
  return made;
}

template <class Call>
bool refused(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    expect(error.code() == "malformed_data", "a damaged body has one code");
    return true;
  }
  return false;
}

template <class Number>
void clean(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(1, 300));
  const auto numbers = static_cast<std::size_t>(random.number(3, 5)), before = static_cast<std::size_t>(random.number(0, 3));
  const std::vector<float> drawn = random.floats(numbers * count, 1500, random.chance(0.5) ? 0.1 : 0.001);
  const std::vector<Number> rows(drawn.begin(), drawn.end());
  Octets body(before + rows.size() * sizeof(Number));
  if (!rows.empty()) std::memcpy(body.data() + before, rows.data(), rows.size() * sizeof(Number));
  const auto axis = [&](std::size_t k) {
    return Column<Number>{body.data() + before + k * sizeof(Number), static_cast<std::ptrdiff_t>(numbers * sizeof(Number))};
  };
  std::vector<float> points(3 * count);
  const std::unique_ptr<bool[]> is_usable(new bool[count]);
  const std::size_t found = usable_points(axis(0), axis(1), axis(2), count, points.data(), is_usable.get());
  expect(found <= count && all_within(points.data(), found, kMaxAbsCoordinate), "only usable points are left");
}

void decode_planes(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 1500));
  const std::size_t bytes = random.chance(0.5) ? 2 : 4, levels = random.chance(0.5) ? 1 : 2;
  const Octets planes = octets(random, 3 * bytes * count), intensity = octets(random, levels * count);
  const std::array<double, 3> origin{random.real(1000), random.real(1000), random.real(1000)};
  std::vector<float> points(3 * count), values(count);
  points_of_planes(planes.data(), count, bytes, 0.01, origin.data(), points.data());
  intensity_of_planes(intensity.data(), count, levels, 0.5, -3, values.data());
}

bool decode_range_image(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 400));
  const auto columns = static_cast<std::size_t>(random.number(1, 900)), rows = static_cast<std::size_t>(random.number(1, 300));
  const Octets gaps = octets(random, (count + 1) / 2 + static_cast<std::size_t>(random.chance(0.5) ? 0 : random.number(0, 99)));
  const Octets ranges = octets(random, count + static_cast<std::size_t>(random.chance(0.5) ? 0 : random.number(0, 99)));
  const std::vector<double> around(columns, 0.6), upward(rows, 0.8);
  std::vector<float> points(3 * count);
  return refused([&] {
    range_image_points({gaps.data(), gaps.size()}, {ranges.data(), ranges.size()}, count, 0.025,
                       {columns, around.data(), around.data()}, {rows, upward.data(), upward.data()}, points.data());
  });
}

bool decode_compact(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 300));
  const Octets planes = octets(random, 4 * count), low = octets(random, (3 * count + 1) / 2);
  CompactGrid grid;
  grid.resolution_m = 0.02;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    grid.lowest[axis] = random.number(-32'768, 32'767);
    grid.size[axis] = random.number(1, random.chance(0.5) ? 65'535 : 9);
  }
  std::vector<float> points(3 * count);
  return refused([&] { compact_points(planes.data(), low.data(), count, grid, points.data()); });
}

void encode_compact(Hostile& random) {
  const auto count = static_cast<std::size_t>(random.number(0, 300));
  std::vector<float> points(3 * count);
  const double reach_m = random.chance(0.5) ? 1000 : 1;
  for (float& v : points) {
    v = static_cast<float>(random.real(reach_m));
    if (!(std::fabs(v) <= 1000.0F)) v = 0;  // the caller checks it
  }
  const CompactPlanes made = compact_planes(points.data(), count, 0.005);
  CompactGrid grid{made.box.lowest, made.box.size, 0.005};
  std::vector<float> decoded(3 * count);
  if (grid.size[0] * grid.size[1] * grid.size[2] > std::int64_t{1} << 32) return;
  compact_points(made.planes.data(), made.low.data(), count, grid, decoded.data());
  for (std::size_t k = 0; k < count; ++k) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float given = points[3 * static_cast<std::size_t>(made.order[k]) + axis];
      expect(std::fabs(decoded[3 * k + axis] - given) < 0.0027, "a point is where it was");
    }
  }
}

void encode_levels(Hostile& random) {
  const auto directions = static_cast<std::size_t>(random.number(0, 999));
  std::vector<float> edges_m(254), levels_m(256), nearest_m(directions), decoded(directions);
  for (std::size_t i = 0; i < 256; ++i) levels_m[i] = static_cast<float>(i);
  for (std::size_t i = 0; i < 254; ++i) edges_m[i] = static_cast<float>(i) + 1.5F;
  for (float& v : nearest_m) {
    v = random.chance(0.3) ? std::numeric_limits<float>::infinity() : static_cast<float>(random.number(1, 255));
  }
  const Bytes content = levels_of_ranges(nearest_m.data(), directions, edges_m.data(), edges_m.size());
  ranges_of_levels({content.data(), content.size()}, levels_m.data(), directions, decoded.data());
  expect(decoded == nearest_m, "the ranges are those that were encoded");
}

bool decode_levels(Hostile& random) {
  const auto directions = static_cast<std::size_t>(random.number(0, 999));
  Octets content = octets(random, (directions + 7) / 8);
  std::size_t returned = 0;
  for (std::size_t i = 0; i < directions; ++i) returned += (content[i / 8] >> (7 - i % 8)) & 1U;
  const Octets levels = octets(random, returned + static_cast<std::size_t>(random.chance(0.5) ? 0 : random.number(0, 5)));
  content.insert(content.end(), levels.begin(), levels.end());
  content.shrink_to_fit();
  const std::vector<float> levels_m(256, 1);
  std::vector<float> nearest_m(directions);
  return refused([&] {
    ranges_of_levels({content.data(), content.size()}, levels_m.data(), directions, nearest_m.data());
  });
}

}  // namespace
}  // namespace firstfix::tests

int main() {
  using namespace firstfix::tests;
  Hostile random(1);
  int images = 0, compact = 0, levels = 0;
  constexpr int kRounds = 3000;
  for (int round = 0; round < kRounds; ++round) {
    clean<float>(random);
    clean<double>(random);
    decode_planes(random);
    encode_compact(random);
    encode_levels(random);
    images += decode_range_image(random);
    compact += decode_compact(random);
    levels += decode_levels(random);
  }
  for (const int number : {images, compact, levels}) {
    expect(number > 0 && number < kRounds, "some bodies are refused, and some are decoded");
  }
}
