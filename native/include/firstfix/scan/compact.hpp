// A scan reduced to what a query needs: a few kilobytes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "firstfix/descriptor/layered_occupancy.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix {

constexpr std::size_t kMaxCompactPoints = 10'000;

// The descriptor of a scan that was levelled on the robot. Sent alone, it is answered with candidates only.
struct ScanDescriptor {
  LayeredOccupancy descriptor;          // must be the map's
  std::vector<std::uint8_t> occupancy;  // bits, see detail::occupancy
  std::array<double, 3> up{0, 0, 1};    // unit vector in the sensor frame
  double height_m = 0;                  // of the sensor above its floor
};

// Voxel means and ranges of a scan, and its descriptor if the robot knows the map's parameters.
struct CompactScan {
  std::vector<Point> points;     // evenly spread over the scan's voxel means
  std::vector<float> nearest_m;  // kDirections ranges, infinite where there is no return
  std::optional<ScanDescriptor> described;
  std::optional<std::vector<float>> time_s{};  // one per point: the mean time of its voxel, in seconds from the stamp
};

}  // namespace firstfix
