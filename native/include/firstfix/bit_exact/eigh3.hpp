// Eigenvectors of a symmetric 3 x 3 matrix by Jacobi's method with a fixed number of sweeps. Equal to
// firstfix.bit_exact.eigh3 to the last bit.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix::detail {

struct SmallestEigenvector {
  Vector3 values{};  // all three eigenvalues, ascending
  Vector3 vector{};  // unit eigenvector of the smallest eigenvalue
};

inline SmallestEigenvector smallest_eigenvector(Matrix3 a) {
  constexpr int kSweeps = 4;
  constexpr std::size_t kPlanes[][3] = {{0, 1, 2}, {0, 2, 1}, {1, 2, 0}};
  Matrix3 v{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (const auto& [p, q, r] : kPlanes) {
      const double off = a[p][q], gap = a[q][q] - a[p][p];
      const double below = std::fabs(gap) + std::sqrt(gap * gap + 4 * (off * off));
      const double tangent = (gap < 0 ? -2.0 : 2.0) * off / std::max(below, 1e-300);
      const double cosine = 1 / std::sqrt(1 + tangent * tangent), sine = tangent * cosine;
      const double shift = tangent * off;
      a[p][p] -= shift;
      a[q][q] += shift;
      a[p][q] = a[q][p] = 0;
      const double rp = a[r][p], rq = a[r][q];
      a[r][p] = a[p][r] = cosine * rp - sine * rq;
      a[r][q] = a[q][r] = sine * rp + cosine * rq;
      for (Vector3& row : v) {
        const double vp = row[p], vq = row[q];
        row[p] = cosine * vp - sine * vq;
        row[q] = sine * vp + cosine * vq;
      }
    }
  }
  std::array<std::size_t, 3> order{0, 1, 2};
  std::stable_sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return a[i][i] < a[j][j]; });
  return {{a[order[0]][order[0]], a[order[1]][order[1]], a[order[2]][order[2]]},
          {v[0][order[0]], v[1][order[0]], v[2][order[0]]}};
}

}  // namespace firstfix::detail
