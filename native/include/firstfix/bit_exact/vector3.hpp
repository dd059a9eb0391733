// Vectors and matrices of three dimensions.
#pragma once

#include <array>
#include <vector>

namespace firstfix::detail {

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<Vector3, 3>;  // row by row

inline double dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// The numbers of a list of vectors, x y z x y z, as the kernels take them.
inline const double* numbers_of(const std::vector<Vector3>& vectors) {
  static_assert(sizeof(Vector3) == 3 * sizeof(double));
  return reinterpret_cast<const double*>(vectors.data());
}
inline double* numbers_of(std::vector<Vector3>& vectors) { return reinterpret_cast<double*>(vectors.data()); }

}  // namespace firstfix::detail
