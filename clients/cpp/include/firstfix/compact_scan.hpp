// A scan in a few kilobytes: what a query needs of it, and no more.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "query_parameters.hpp"
#include "scan.hpp"

namespace firstfix {

constexpr std::size_t kMaxCompactPoints = 10'000;

// A scan levelled and described on the robot. Alone it is a query too: for candidates only.
struct ScanDescriptor {
  DescriptorParameters parameters;
  std::vector<std::uint8_t> occupancy;  // bits, layer by layer, ring by ring, most significant first
  std::array<double, 3> up{0, 0, 1};    // unit vector against gravity, sensor frame
  double height_m = 0;                  // of the sensor above its floor
};

struct CompactScan {
  std::vector<Point> points;     // an even part of the scan's voxel means
  std::vector<float> nearest_m;  // kDirections ranges, infinite where nothing is
  std::optional<ScanDescriptor> described;
};

}  // namespace firstfix
