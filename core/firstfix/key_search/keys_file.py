"""Keys as they are: for the searches that make their trees anew when a version is loaded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FILE = "keys.npy"


def save_keys(keys: NDArray[np.float32], directory: Path) -> None:
    np.save(directory / FILE, keys)


def load_keys(directory: Path) -> NDArray[np.float32]:
    """Memory-mapped, (n, d)."""
    keys: NDArray[np.float32] = np.load(directory / FILE, mmap_mode="r")
    return keys
