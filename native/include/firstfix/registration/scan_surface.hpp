// A scan's points and normals, coordinate by coordinate, filled up with zeros to whole lanes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

struct ScanSurface {
  std::size_t count;
  std::vector<float> x, y, z, nx, ny, nz;
  std::vector<std::int32_t> oriented;

  // oriented: one a point, not 0: the normal surely points to the sensor.
  ScanSurface(Vectors<const float> points, Vectors<const float> normals, const std::uint8_t* oriented_normal)
      : count(points.size) {
    for (std::vector<float>* lane : {&x, &y, &z, &nx, &ny, &nz}) lane->resize(padded(count));
    oriented.resize(padded(count));
    for (std::size_t i = 0; i < count; ++i) {
      const float *p = points[i], *n = normals[i];
      x[i] = p[0], y[i] = p[1], z[i] = p[2];
      nx[i] = n[0], ny[i] = n[1], nz[i] = n[2];
      oriented[i] = oriented_normal[i] != 0 ? -1 : 0;
    }
  }
};

}  // namespace firstfix
