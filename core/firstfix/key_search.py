"""Nearest templates by key: FAISS, 8 bits a number, exhaustive (exact order, linear time)."""

from __future__ import annotations

from pathlib import Path

import faiss
import numpy as np
from numpy.typing import NDArray


class KeySearch:
    """(n, d) keys, searched by L2 distance. Searching is thread-safe; building is not."""

    def __init__(self, index: faiss.Index) -> None:
        self._index = index

    @classmethod
    def build(cls, keys: NDArray[np.float32]) -> KeySearch:
        index = faiss.IndexScalarQuantizer(keys.shape[1], faiss.ScalarQuantizer.QT_8bit, faiss.METRIC_L2)
        index.train(keys)
        index.add(keys)
        return cls(index)

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """(d,) key to at most ``count`` template rows, nearest first."""
        _, rows = self._index.search(key[None], min(count, self._index.ntotal))
        found: NDArray[np.int64] = rows[0]
        return found

    def save(self, path: Path) -> None:
        faiss.write_index(self._index, str(path))

    @classmethod
    def load(cls, path: Path) -> KeySearch:
        return cls(faiss.read_index(str(path), faiss.IO_FLAG_MMAP | faiss.IO_FLAG_READ_ONLY))
