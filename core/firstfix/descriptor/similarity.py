"""Similarity of Scan Contexts, column by column (paper III.B, equations 4 to 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Columns:
    """Contexts with their columns scaled to length one.

    Attributes:
        unit: (n, rings * sectors) float32, 0 in empty columns.
        filled: (n, sectors) float32, 1 for a column that is not empty, else 0.
    """

    unit: NDArray[np.float32]
    filled: NDArray[np.float32]

    @classmethod
    def of(cls, context: NDArray[np.floating]) -> Columns:
        """Columns of contexts, (n, rings, sectors) heights."""
        heights = context.astype(np.float32)
        norm = np.sqrt(np.einsum("nrs,nrs->ns", heights, heights))
        filled = norm > 0
        heights /= np.where(filled, norm, 1)[:, None]
        return cls(heights.reshape(len(heights), -1), filled.astype(np.float32))

    def turned(self, shifts: NDArray[np.intp]) -> Columns:
        """One context at each of (k,) shifts: its column j becomes column j + shift."""
        sectors = self.filled.shape[1]
        source = (np.arange(sectors) - shifts[:, None]) % sectors  # (k, sectors)
        unit = self.unit.reshape(-1, sectors)[:, source]  # (rings, k, sectors)
        return Columns(
            np.ascontiguousarray(unit.transpose(1, 0, 2)).reshape(len(shifts), -1), self.filled[0, source]
        )


def similarity(x: Columns, y: Columns) -> NDArray[np.float32]:
    """Similarities (n, m) in 0..1 of n and m contexts: mean cosine of their columns (equation 4).

    The paper does not say what an empty column's cosine is. Here a column that is empty in both is not
    counted, and one that is empty in only one counts with cosine 0. So s(x, x) = 1, whatever is empty.
    """
    both = x.filled @ y.filled.T
    counted = x.filled.sum(axis=1)[:, None] + y.filled.sum(axis=1) - both
    cosines: NDArray[np.float32] = x.unit @ y.unit.T
    cosines /= np.maximum(counted, np.float32(1))
    return np.minimum(cosines, np.float32(1), out=cosines)


def best_shift(
    query: Columns, templates: Columns, shifts: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Column shift at which each template is most similar to the query (equation 6).

    Args:
        query: one context.
        shifts: (k,) shifts to try; of equally good ones the first is taken.

    Returns:
        (n,) shift s: column j of the query is compared with column j + s of the template; (n,) similarity.
    """
    scores = similarity(templates, query.turned(shifts))
    best = scores.argmax(axis=1)
    return shifts[best], scores[np.arange(len(scores)), best]
