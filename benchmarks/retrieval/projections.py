"""Keys in fewer numbers: what tells places apart, and less of what a disturbance changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

SHRINKAGE = 0.7


def lda(
    keys: NDArray[np.float32], within: NDArray[np.float32], numbers: int, shrinkage: float = SHRINKAGE
) -> NDArray[np.float32]:
    """Linear discriminant analysis: the directions w of the largest w'Bw / w'Ww, scaled so that w'Ww = 1.

    Args:
        keys: (n, d) of the templates, whose covariance is B.
        within: (m, d) differences between disturbed scans' keys and their places' own, whose scatter is W.
        shrinkage: 0..1, the share of W that is replaced by a multiple of the identity of the same trace.

    Returns:
        (d, numbers), or (d, d) where that is less: multiply keys by it from the right.
    """
    scatter = within.T.astype(np.float64) @ within / len(within)
    d = len(scatter)
    scatter = (1 - shrinkage) * scatter + shrinkage * np.trace(scatter) / d * np.eye(d)
    _, vectors = eigh(_covariance(keys), scatter, subset_by_index=[max(0, d - numbers), d - 1])
    return vectors[:, ::-1].astype(np.float32)


def whitening(keys: NDArray[np.float32], numbers: int) -> NDArray[np.float32]:
    """The control that knows nothing of disturbances: principal components, each of unit variance."""
    values, vectors = np.linalg.eigh(_covariance(keys))
    values, vectors = values[::-1][:numbers], vectors[:, ::-1][:, :numbers]
    return (vectors / np.sqrt(values + values.mean() * 0.1)).astype(np.float32)


def _covariance(keys: NDArray[np.float32]) -> NDArray[np.float64]:
    centred = keys.astype(np.float64) - keys.mean(axis=0, dtype=np.float64)
    covariance: NDArray[np.float64] = centred.T @ centred / len(keys)
    return covariance
