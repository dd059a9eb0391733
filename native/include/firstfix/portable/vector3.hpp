// Vectors and matrices of three dimensions.
#pragma once

#include <array>

namespace firstfix::detail {

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<Vector3, 3>;  // row by row

inline double dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

}  // namespace firstfix::detail
