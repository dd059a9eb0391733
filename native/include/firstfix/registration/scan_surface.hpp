// A scan's points and normals, coordinate by coordinate, filled up with zeros to whole lanes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/eight_lanes.hpp"

namespace firstfix {

struct ScanSurface {
  std::size_t count;
  std::vector<float> x, y, z, nx, ny, nz;
  std::vector<std::int32_t> oriented;

  // points, normals: (count, 3). oriented: (count,), not 0: the normal surely points to the sensor.
  ScanSurface(const float* points, const float* normals, const std::uint8_t* oriented_normal, std::size_t size)
      : count(size) {
    for (std::vector<float>* lane : {&x, &y, &z, &nx, &ny, &nz}) lane->resize(padded(size));
    oriented.resize(padded(size));
    for (std::size_t i = 0; i < size; ++i) {
      x[i] = points[3 * i], y[i] = points[3 * i + 1], z[i] = points[3 * i + 2];
      nx[i] = normals[3 * i], ny[i] = normals[3 * i + 1], nz[i] = normals[3 * i + 2];
      oriented[i] = oriented_normal[i] != 0 ? -1 : 0;
    }
  }
};

}  // namespace firstfix
