// Eigenvectors of a symmetric 3 x 3 matrix by Jacobi's method with a fixed number of sweeps. Equal to
// firstfix.bit_exact.eigh3 to the last bit.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix::detail {

struct SmallestEigenvector {
  Vector3 values{};  // all three eigenvalues, ascending
  Vector3 vector{};  // unit eigenvector of the smallest eigenvalue
};

// kCount symmetric matrices and the vectors that are turned with them, number by number: compilers then take as many matrices at
// once as a register has numbers.
template <std::size_t kCount>
struct JacobiStep {
  double a[3][3][kCount], v[3][3][kCount];

  // Turns by the angle at which the numbers (p, q) vanish; r is the other axis.
  template <std::size_t p, std::size_t q, std::size_t r>
  void turn() {
    for (std::size_t i = 0; i < kCount; ++i) {
      const double off = a[p][q][i], gap = a[q][q][i] - a[p][p][i];
      const double below = std::fabs(gap) + std::sqrt(gap * gap + 4 * (off * off));
      const double tangent = (gap < 0 ? -2.0 : 2.0) * off / (below < 1e-300 ? 1e-300 : below);
      const double cosine = 1 / std::sqrt(1 + tangent * tangent), sine = tangent * cosine;
      const double shift = tangent * off, rp = a[r][p][i], rq = a[r][q][i];
      a[p][p][i] -= shift;
      a[q][q][i] += shift;
      a[p][q][i] = a[q][p][i] = 0;
      a[r][p][i] = a[p][r][i] = cosine * rp - sine * rq;
      a[r][q][i] = a[q][r][i] = sine * rp + cosine * rq;
      const double v0 = v[0][p][i], v1 = v[1][p][i], v2 = v[2][p][i], w0 = v[0][q][i], w1 = v[1][q][i], w2 = v[2][q][i];
      v[0][p][i] = cosine * v0 - sine * w0, v[0][q][i] = sine * v0 + cosine * w0;
      v[1][p][i] = cosine * v1 - sine * w1, v[1][q][i] = sine * v1 + cosine * w1;
      v[2][p][i] = cosine * v2 - sine * w2, v[2][q][i] = sine * v2 + cosine * w2;
    }
  }
};

// Those of kCount matrices.
template <std::size_t kCount>
std::array<SmallestEigenvector, kCount> smallest_eigenvectors(const std::array<Matrix3, kCount>& matrices) {
  constexpr int kSweeps = 4;
  JacobiStep<kCount> step;
  auto& [a, v] = step;
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      for (std::size_t i = 0; i < kCount; ++i) {
        a[row][column][i] = matrices[i][row][column];
        v[row][column][i] = row == column ? 1 : 0;
      }
    }
  }
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    step.template turn<0, 1, 2>();
    step.template turn<0, 2, 1>();
    step.template turn<1, 2, 0>();
  }
  std::array<SmallestEigenvector, kCount> found;
  for (std::size_t i = 0; i < kCount; ++i) {
    const double diagonal[3] = {a[0][0][i], a[1][1][i], a[2][2][i]};
    std::size_t least = 0, middle = 1, most = 2;  // sorted by insertion: equal ones keep their order
    if (diagonal[middle] < diagonal[least]) std::swap(least, middle);
    if (diagonal[most] < diagonal[middle]) std::swap(middle, most);
    if (diagonal[middle] < diagonal[least]) std::swap(least, middle);
    found[i] = {{diagonal[least], diagonal[middle], diagonal[most]}, {v[0][least][i], v[1][least][i], v[2][least][i]}};
  }
  return found;
}

inline SmallestEigenvector smallest_eigenvector(const Matrix3& a) { return smallest_eigenvectors<1>({a})[0]; }

}  // namespace firstfix::detail
