"""Eigenvectors of many symmetric 3 x 3 matrices, the same on every machine and in every language.

Jacobi's method with a fixed number of sweeps, on all matrices at once. IEEE 754 defines the rounding of every
step, which no eigensolver of a library promises.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SWEEPS = 4  # enough for 12 digits; each sweep at least doubles the number of digits
_TINY = 1e-300


def smallest_eigenvectors(matrices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The eigenvalues of symmetric matrices, and the eigenvectors of the smallest ones.

    Args:
        matrices: (n, 3, 3) symmetric.

    Returns:
        (n, 3) eigenvalues, ascending, and the (n, 3) unit eigenvectors of the smallest eigenvalues.
    """
    n = len(matrices)
    a = np.ascontiguousarray(matrices.transpose(1, 2, 0))  # (3, 3, n): every element a row
    v = np.zeros((3, 3, n))
    v[0, 0] = v[1, 1] = v[2, 2] = 1.0
    for _ in range(_SWEEPS):
        for p, q, r in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            _rotate(a, v, p, q, r)
    values = np.stack([a[0, 0], a[1, 1], a[2, 2]], axis=1)
    order = np.argsort(values, axis=1, kind="stable")
    axes = v[:, order[:, 0], np.arange(n)].T
    return np.take_along_axis(values, order, axis=1), axes


def _rotate(a: NDArray[np.float64], v: NDArray[np.float64], p: int, q: int, r: int) -> None:
    """Rotate in the plane of p and q so that a[p, q] becomes 0; r is the third axis."""
    off, gap = a[p, q], a[q, q] - a[p, p]
    below = np.abs(gap) + np.sqrt(gap * gap + 4 * (off * off))
    tangent = np.where(gap < 0, -2.0, 2.0) * off / np.maximum(below, _TINY)
    cosine = 1 / np.sqrt(1 + tangent * tangent)
    sine = tangent * cosine
    shift = tangent * off
    a[p, p] -= shift
    a[q, q] += shift
    a[p, q] = a[q, p] = 0.0
    a[r, p], a[r, q] = cosine * a[r, p] - sine * a[r, q], sine * a[r, p] + cosine * a[r, q]
    a[p, r], a[q, r] = a[r, p], a[r, q]
    v[:, p], v[:, q] = cosine * v[:, p] - sine * v[:, q], sine * v[:, p] + cosine * v[:, q]
