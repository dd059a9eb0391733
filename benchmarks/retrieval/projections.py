"""Keys in fewer numbers that nothing was learned for: what the builder's ``discriminants`` must beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def whitening(keys: NDArray[np.float32], numbers: int) -> NDArray[np.float32]:
    """Principal components, each of unit variance."""
    values, vectors = np.linalg.eigh(np.cov(keys.T))
    values, vectors = values[::-1][:numbers], vectors[:, ::-1][:, :numbers]
    return (vectors / np.sqrt(values + values.mean() * 0.1)).astype(np.float32)
