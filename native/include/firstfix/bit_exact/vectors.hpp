// Vectors and matrices, and lists of them that somebody else owns.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace firstfix {

// Numbers in a row.
template <class T>
struct Span {
  T* data = nullptr;
  std::size_t size = 0;

  T& operator[](std::size_t i) const { return data[i]; }
  T* begin() const { return data; }
  T* end() const { return data + size; }
};

// Vectors of three numbers in a row: x y z x y z.
template <class T>
struct Vectors {
  T* data;
  std::size_t size;

  T* operator[](std::size_t i) const { return data + 3 * i; }
};

// Matrices, row by row. A pose T_a_b, (4, 4), brings a point from frame b to frame a.
using PoseMatrix = std::array<double, 16>;
using Matrix6 = std::array<double, 36>;
using Vector6 = std::array<double, 6>;  // a twist: linear, then angular

// A pose in single precision, its position counted from a corner.
struct FloatPose {
  float R[9], t[3];

  explicit FloatPose(const PoseMatrix& T, const float (&corner_m)[3] = {0, 0, 0}) {
    for (std::size_t row = 0; row < 3; ++row) {
      for (std::size_t column = 0; column < 3; ++column) R[3 * row + column] = static_cast<float>(T[4 * row + column]);
      t[row] = static_cast<float>(T[4 * row + 3] - static_cast<double>(corner_m[row]));
    }
  }
};

namespace detail {

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<Vector3, 3>;  // row by row

inline double dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// The numbers of a list of vectors, x y z x y z, as the kernels take them.
inline const double* numbers_of(const std::vector<Vector3>& vectors) {
  static_assert(sizeof(Vector3) == 3 * sizeof(double));
  return reinterpret_cast<const double*>(vectors.data());
}
inline double* numbers_of(std::vector<Vector3>& vectors) { return reinterpret_cast<double*>(vectors.data()); }

}  // namespace detail
}  // namespace firstfix
