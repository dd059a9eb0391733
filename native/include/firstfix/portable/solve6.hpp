// Solves six linear equations with a symmetric positive definite matrix, by Cholesky's method.
#pragma once

#include <cmath>

namespace firstfix {

// matrix: (6, 6), overwritten. vector: (6,), the right side, then the solution. Returns false if the matrix is not positive
// definite; then nothing is solved.
inline bool solve6(double* matrix, double* vector) {
  for (int column = 0; column < 6; ++column) {
    for (int row = column; row < 6; ++row) {
      double value = matrix[6 * row + column];
      for (int k = 0; k < column; ++k) value -= matrix[6 * row + k] * matrix[6 * column + k];
      if (row > column) {
        matrix[6 * row + column] = value / matrix[7 * column];
      } else if (value > 0 && std::isfinite(value)) {
        matrix[7 * column] = std::sqrt(value);
      } else {
        return false;
      }
    }
  }
  for (int row = 0; row < 6; ++row) {
    for (int k = 0; k < row; ++k) vector[row] -= matrix[6 * row + k] * vector[k];
    vector[row] /= matrix[7 * row];
  }
  for (int row = 5; row >= 0; --row) {
    for (int k = row + 1; k < 6; ++k) vector[row] -= matrix[6 * k + row] * vector[k];
    vector[row] /= matrix[7 * row];
  }
  return true;
}

}  // namespace firstfix
