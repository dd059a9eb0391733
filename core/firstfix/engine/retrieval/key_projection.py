"""Keys in fewer numbers, where a version has learned which of them tell its places apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FILE = "key_projection.npy"


def save_projection(projection: NDArray[np.float32], directory: Path) -> None:
    np.save(directory / FILE, projection)


def load_projection(directory: Path) -> NDArray[np.float32] | None:
    """(d, numbers), by which keys are multiplied from the right; None: keys are as they come."""
    path = directory / FILE
    return np.load(path) if path.exists() else None
