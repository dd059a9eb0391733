// Eigenvalues and eigenvectors of a small symmetric matrix, by Jacobi's method in a fixed order.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>

namespace firstfix {

template <std::size_t N>
struct Eigensystem {
  std::array<double, N> values;       // ascending
  std::array<double, N * N> vectors;  // column by column, of unit length
};

// matrix: (N, N), symmetric.
template <std::size_t N>
Eigensystem<N> eigh(std::array<double, N * N> a) {
  constexpr int kMostSweeps = 20;  // a handful do, of any matrix of numbers
  std::array<double, N * N> v{};
  for (std::size_t i = 0; i < N; ++i) v[(N + 1) * i] = 1;
  bool turns = true;
  for (int sweep = 0; sweep < kMostSweeps && turns; ++sweep) {
    turns = false;
    for (std::size_t p = 0; p < N; ++p) {
      for (std::size_t q = p + 1; q < N; ++q) {
        const double off = a[N * p + q], least = std::min(std::fabs(a[(N + 1) * p]), std::fabs(a[(N + 1) * q]));
        if (least + std::fabs(off) == least) continue;
        turns = true;
        const double gap = a[(N + 1) * q] - a[(N + 1) * p];
        const double tangent = (gap < 0 ? -2.0 : 2.0) * off / (std::fabs(gap) + std::sqrt(gap * gap + 4 * (off * off)));
        const double cosine = 1 / std::sqrt(1 + tangent * tangent), sine = tangent * cosine;
        a[(N + 1) * p] -= tangent * off, a[(N + 1) * q] += tangent * off;
        a[N * p + q] = a[N * q + p] = 0;
        for (std::size_t k = 0; k < N; ++k) {
          const double vp = v[N * k + p], vq = v[N * k + q];
          v[N * k + p] = cosine * vp - sine * vq, v[N * k + q] = sine * vp + cosine * vq;
          if (k == p || k == q) continue;
          const double ap = a[N * k + p], aq = a[N * k + q];
          a[N * k + p] = a[N * p + k] = cosine * ap - sine * aq;
          a[N * k + q] = a[N * q + k] = sine * ap + cosine * aq;
        }
      }
    }
  }
  std::array<std::size_t, N> order;
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return a[(N + 1) * i] < a[(N + 1) * j]; });
  Eigensystem<N> found;
  for (std::size_t k = 0; k < N; ++k) {
    found.values[k] = a[(N + 1) * order[k]];
    for (std::size_t row = 0; row < N; ++row) found.vectors[N * row + k] = v[N * row + order[k]];
  }
  return found;
}

}  // namespace firstfix
