// Damaged input and invalid calls must end in an Error, and in nothing else. Meant to be built with
// -fsanitize=address,undefined. The seed is fixed.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <random>

#include "../examples/scan_file.hpp"
#include "programs.hpp"
#include "vectors.hpp"

namespace firstfix::test {
namespace {

constexpr int kRounds = 300;

Bytes damaged(Bytes body, std::mt19937& random) {
  const auto below = [&random](std::size_t end) { return random() % std::max<std::size_t>(1, end); };
  switch (random() % 4) {
    case 0: body.resize(below(body.size())); break;
    case 1: body.insert(body.end(), below(9), static_cast<std::uint8_t>(random())); break;
    default: break;
  }
  for (std::size_t k = below(6); k > 0 && !body.empty(); --k) {
    // Mostly in the headers: zstd itself checks the rest.
    const std::size_t at = below(random() % 3 == 0 ? body.size() : std::min<std::size_t>(body.size(), 64));
    static constexpr std::uint8_t kValues[] = {0, 1, 0x7f, 0x80, 0xff};
    body[at] = random() % 2 == 0 ? kValues[random() % 5] : static_cast<std::uint8_t>(random());
  }
  return body;
}

void decode(const Bytes& body) {
  if (body.size() < 4 || std::memcmp(body.data(), "FFQY", 4) == 0) {
    decode_query(body);
  } else if (std::memcmp(body.data(), "FFSS", 4) == 0) {
    decode_scans(body);
  } else {
    decode_scan(body);
  }
}

template <typename Call>
bool refused(const Call& call) {
  try {
    call();
  } catch (const Error&) {
    return true;
  }
  return false;
}

std::vector<Bytes> files(const std::string& folder, const std::string& ending) {
  std::vector<std::string> paths;
  for (const auto& one : std::filesystem::recursive_directory_iterator(folder)) {
    if (one.path().extension() == ending) paths.push_back(one.path().string());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Bytes> read;
  for (const std::string& path : paths) read.push_back(read_file(path));
  return read;
}

bool bodies(const std::string& folder) {
  std::mt19937 random(1);
  int tried = 0, accepted = 0;
  std::vector<Bytes> all = files(folder, ".bin");
  for (const auto& [name, body] : read_damaged(folder)) all.push_back(body);
  for (const Bytes& body : all) {
    for (int k = 0; k < kRounds; ++k, ++tried) {
      const Bytes changed = damaged(body, random);
      if (!refused([&changed] { decode(changed); })) ++accepted;
    }
  }
  std::printf("%d damaged bodies, %d of them accepted\n", tried, accepted);
  return tried > accepted;
}

bool documents(const std::string& folder) {
  std::mt19937 random(2);
  int tried = 0;
  for (const Bytes& text : files(folder + "documents", ".json")) {
    for (int k = 0; k < kRounds; ++k, ++tried) {
      const Bytes changed = damaged(text, random);
      const std::string document(changed.begin(), changed.end());
      refused([&document] { parse_localization(document); });
      refused([&document] { parse_geopose(document); });
      refused([&document] { parse_maps(document); });
      refused([&document] { parse_descriptor_parameters(document); });
      refused([&document] { parse_problem(document, 400); });
    }
  }
  std::printf("%d damaged documents\n", tried);
  return tried > 0 && refused([] { parse_localization(std::string(1'000'000, '[')); });
}

int failures = 0;

void check(bool passed, const char* what) {
  if (passed) return;
  ++failures;
  std::printf("failed: %s\n", what);
}

void calls() {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
  const Scan odd{{{kNan, 0, 0}, {kInf, -kInf, 0}, {3e38F, 0, 0}, {1, 2, 3}, {0, 0, 0}, {1e-40F, 0, -1e-40F}}, {}, {}};
  for (const ScanForm form : {ScanForm::points, ScanForm::range_image}) {
    check(refused([&] { encode_scan(odd, {}, {}, form); }), "points that are not finite are refused as they are");
    check(!refused([&] { decode_scan(encode_scan(cleaned(odd), {}, {}, form)); }), "what is left can be sent whole");
    check(!refused([&] { decode_scan(encode_scan(Scan{}, {}, {}, form)); }), "no points can be sent");
  }
  check(cleaned(odd).points.size() == 3, "and left out by cleaned");
  check(condense(odd).points.size() == 1, "and by condense");
  check(!refused([&odd] { compact_body(condense(odd)); }), "what is left can be sent");
  check(refused([] { encode_scan(Scan{std::vector<Point>(3), std::vector<float>(2), {}}); }), "an intensity is missing");
  check(refused([] { cleaned(Scan{std::vector<Point>(3), std::vector<float>(4), {}}); }), "one intensity too many");
  check(refused([] { encode_query(CompactScan{{}, {}, {}}); }), "a compact scan without a view");
  for (const ScanForm form : {ScanForm::points, ScanForm::range_image}) {
    check(refused([form] { encode_scan(Scan{std::vector<Point>(3), {}, {}, std::vector<float>(2)}, {}, {}, form); }), "a time is missing");
    check(refused([form] { encode_scan(Scan{std::vector<Point>(1), {}, {}, std::vector<float>{kNan}}, {}, {}, form); }), "no time");
  }
  check(refused([] { cleaned(Scan{std::vector<Point>(3), {}, {}, std::vector<float>(4)}); }), "one time too many");
  check(refused([] { condense(Scan{std::vector<Point>(3), {}, {}, std::vector<float>(2)}); }), "a time of a voxel is missing");
  for (const double bad : {0.0, -1.0, 1e-300, 1e300, std::numeric_limits<double>::quiet_NaN()}) {
    DescriptorParameters parameters;
    parameters.voxel_m = bad;
    check(refused([&] { condense(odd, parameters); }), "a voxel of no use");
    parameters = DescriptorParameters{};
    parameters.descriptor = LayeredOccupancy{20, 60, bad, {0, 1}};
    check(refused([&] { describe(odd, parameters); }), "a descriptor's range of no use");
    check(refused([&] { encode_scan(cleaned(odd), bad); }), "a resolution of no use");
    check(refused([&] { encode_scan(cleaned(odd), bad, {}, ScanForm::range_image); }), "of a range image neither");
    check(refused([&] { encode_query(condense(odd), bad); }), "a compact query's resolution of no use");
  }
  DescriptorParameters parameters;
  parameters.descriptor = LayeredOccupancy{};
  check(refused([&] { describe(odd, parameters, Gravity{0, 0, 0}); }), "gravity without a direction");
  check(!refused([&] { describe(Scan{}, parameters); }), "a scan without points is described");
  parameters.descriptor->layer_edges_m = {1, 0};
  check(refused([&] { describe(odd, parameters); }), "layers that descend");
  parameters.descriptor->layer_edges_m.clear();
  check(refused([&] { describe(odd, parameters); }), "no layers");
  // richer than a scan gets: every voxel mean apart from every other, no range like its neighbour's
  std::mt19937 random(3);
  Scan rich;
  for (int i = 0; i < 60'000; ++i) {
    const auto metres = [&random] { return static_cast<float>(random() % 90'000) / 1000 - 45; };
    rich.points.push_back({metres(), metres(), metres() / 10});
  }
  check(encode_query(condense(rich)).size() > 10'000, "the scan is rich");
  check(compact_body(condense(rich)).size() < 10'000, "a rich scan is thinned until it fits");
  rich.time_s.emplace(rich.points.size(), 0.01F);
  check(compact_body(condense(rich)).size() < 10'000, "and so are its times");
}

// Damaged files of the example's reader.
bool point_files() {
  const std::string head =
      "# .PCD v0.7\nFIELDS ring x y z\nSIZE 2 4 4 4\nTYPE U F F F\nCOUNT 1 1 1 1\nPOINTS 3\nDATA ";
  const std::string binary = head + "binary\n" + std::string(42, 'A'), text = head + "ascii\n1 2 3 4\n1 2 3 4\n1 2 3 4\n";
  std::mt19937 random(4);
  int tried = 0, accepted = 0;
  for (const std::string& good : {binary, text}) {
    std::istringstream whole(good);
    check(example::read_pcd(whole).points.size() == 3, "the file is good before it is damaged");
    for (int k = 0; k < kRounds; ++k, ++tried) {
      Bytes changed = damaged({good.begin(), good.end()}, random);
      std::istringstream in(std::string(changed.begin(), changed.end()));
      if (!refused([&in] { example::read_pcd(in); })) ++accepted;
    }
  }
  std::printf("%d damaged files, %d of them accepted\n", tried, accepted);
  return tried > accepted;
}

}  // namespace

int hostile(const std::string& folder) {
  calls();
  check(bodies(folder), "damaged bodies are refused");
  check(documents(folder), "damaged documents are refused");
  check(point_files(), "damaged files are refused");
  return failures == 0 ? 0 : 1;
}

}  // namespace firstfix::test
