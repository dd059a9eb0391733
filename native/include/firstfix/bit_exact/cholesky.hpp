// Solves linear equations with a symmetric positive definite matrix, by Cholesky's method.
#pragma once

#include <cmath>

namespace firstfix {

// matrix: (N, N), overwritten. vector: (N,), the right side, then the solution. Returns false if the matrix is not positive
// definite; then nothing is solved.
template <int N>
bool solve_definite(double* matrix, double* vector) {
  for (int column = 0; column < N; ++column) {
    for (int row = column; row < N; ++row) {
      double value = matrix[N * row + column];
      for (int k = 0; k < column; ++k) value -= matrix[N * row + k] * matrix[N * column + k];
      if (row > column) {
        matrix[N * row + column] = value / matrix[(N + 1) * column];
      } else if (value > 0 && std::isfinite(value)) {
        matrix[(N + 1) * column] = std::sqrt(value);
      } else {
        return false;
      }
    }
  }
  for (int row = 0; row < N; ++row) {
    for (int k = 0; k < row; ++k) vector[row] -= matrix[N * row + k] * vector[k];
    vector[row] /= matrix[(N + 1) * row];
  }
  for (int row = N - 1; row >= 0; --row) {
    for (int k = row + 1; k < N; ++k) vector[row] -= matrix[N * k + row] * vector[k];
    vector[row] /= matrix[(N + 1) * row];
  }
  return true;
}

}  // namespace firstfix
