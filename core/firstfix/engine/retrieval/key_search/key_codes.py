"""Codes of all keys of one FAISS index with 8 bits a number, where they lie in memory."""

from __future__ import annotations

from dataclasses import dataclass

import faiss
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class KeyCodes:
    """Codes of n keys: a code c of number k stands for ``lowest[k] + (c + 0.5) / 255 * range[k]``.

    Attributes:
        index: whose memory they are.
        codes: (n, d) uint8.
        lowest: (d,) float32.
        range: (d,) float32.
    """

    index: faiss.IndexScalarQuantizer
    codes: NDArray[np.uint8]
    lowest: NDArray[np.float32]
    range: NDArray[np.float32]

    @classmethod
    def of(cls, index: faiss.Index) -> KeyCodes | None:
        """Codes of an index; None: it has others."""
        if not isinstance(index, faiss.IndexScalarQuantizer) or index.metric_type != faiss.METRIC_L2:
            return None
        if index.sq.qtype != faiss.ScalarQuantizer.QT_8bit or index.codes.size() != index.ntotal * index.d:
            return None
        codes = faiss.rev_swig_ptr(index.codes.data(), index.codes.size()).reshape(index.ntotal, index.d)
        lowest, widths = faiss.vector_to_array(index.sq.trained).reshape(2, index.d)
        return cls(index, codes, lowest, widths)
