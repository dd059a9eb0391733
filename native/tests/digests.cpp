// Prints a digest of what a robot computes from scans, and of what is decoded. The same on every processor.
//
//   digests SCAN.f32...     files of x y z
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "firstfix/scan/condense.hpp"
#include "firstfix/scan/usable_points.hpp"
#include "firstfix/wire/planes.hpp"
#include "firstfix/wire/range_image_points.hpp"
#include "hostile.hpp"

namespace firstfix::tests {
namespace {

// FNV-1a.
class Digest {
 public:
  template <class Value>
  void add(const Value* values, std::size_t count) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(values);
    for (std::size_t i = 0; i < count * sizeof(Value); ++i) state_ = (state_ ^ bytes[i]) * 1099511628211ULL;
  }

  void print(const std::string& name) const {
    std::printf("%s %016llx\n", name.c_str(), static_cast<unsigned long long>(state_));
  }

 private:
  std::uint64_t state_ = 14695981039346656037ULL;
};

void condensed(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  expect(static_cast<bool>(in), "a scan can be read");
  const std::vector<char> bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  Scan scan;
  scan.points.resize(bytes.size() / sizeof(Point));
  if (!scan.points.empty()) std::memcpy(numbers_of(scan.points), bytes.data(), scan.points.size() * sizeof(Point));
  DescriptorParameters parameters;
  parameters.descriptor = LayeredOccupancy{};
  const CompactScan compact = condense(cleaned(scan), parameters);
  Digest points, view, described;
  points.add(compact.points.data(), compact.points.size());
  view.add(compact.nearest_m.data(), compact.nearest_m.size());
  const ScanDescriptor whole = describe(cleaned(scan), parameters);
  described.add(whole.occupancy.data(), whole.occupancy.size());
  described.add(whole.up.data(), whole.up.size());
  described.add(&whole.height_m, 1);
  const std::string name = path.substr(path.rfind('/') + 1);
  points.print(name + " points");
  view.print(name + " view");
  described.print(name + " descriptor");
}

void decoded() {
  Hostile random(3);
  constexpr std::size_t kCount = 5001;
  std::vector<std::uint8_t> octets(12 * kCount);
  for (std::uint8_t& one : octets) one = static_cast<std::uint8_t>(random.number(0, 255));
  std::vector<float> points(3 * kCount);
  const std::array<double, 3> origin{1.25, -300.1, 0.007};
  for (const std::size_t bytes : {2, 4}) {
    Digest digest;
    points_of_planes(octets.data(), kCount, bytes, 0.01, origin.data(), points.data());
    digest.add(points.data(), points.size());
    digest.print("points of " + std::to_string(bytes) + " bytes");
  }
  std::vector<std::uint8_t> gaps(octets.begin(), octets.begin() + kCount / 2 + 1), ranges(kCount, 2);
  for (std::uint8_t& two : gaps) two &= 0x77U;
  gaps.back() = 0;
  std::vector<double> angles(4096);
  for (double& one : angles) one = random.real(1, 0);
  const Angles table{angles.size(), angles.data(), angles.data()};
  range_image_points({gaps.data(), gaps.size()}, {ranges.data(), ranges.size()}, kCount, 0.025, table, table, points.data());
  Digest image;
  image.add(points.data(), points.size());
  image.print("range image");
}

}  // namespace
}  // namespace firstfix::tests

int main(int count, char** paths) {
  for (int i = 1; i < count; ++i) firstfix::tests::condensed(paths[i]);
  firstfix::tests::decoded();
}
