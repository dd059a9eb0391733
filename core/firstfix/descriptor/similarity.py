"""How alike two Scan Contexts are: column by column (paper III.B, equations 4 to 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Columns:
    """Contexts, their columns scaled to length one.

    Attributes:
        unit: (n, rings * sectors) float32, 0 in empty columns.
        filled: (n, sectors) float32, 1 where the column holds anything.
    """

    unit: NDArray[np.float32]
    filled: NDArray[np.float32]

    @classmethod
    def of(cls, context: NDArray[np.floating]) -> Columns:
        """(n, rings, sectors) heights."""
        heights = context.astype(np.float32)
        norm = np.sqrt(np.einsum("nrs,nrs->ns", heights, heights))
        filled = norm > 0
        heights /= np.where(filled, norm, 1)[:, None]
        return cls(heights.reshape(len(heights), -1), filled.astype(np.float32))

    def turned(self, shifts: NDArray[np.intp]) -> Columns:
        """One context to the (k,) contexts whose column j + shift is its column j."""
        sectors = self.filled.shape[1]
        source = (np.arange(sectors) - shifts[:, None]) % sectors  # (k, sectors)
        unit = self.unit.reshape(-1, sectors)[:, source]  # (rings, k, sectors)
        return Columns(
            np.ascontiguousarray(unit.transpose(1, 0, 2)).reshape(len(shifts), -1), self.filled[0, source]
        )


def similarity(x: Columns, y: Columns) -> NDArray[np.float32]:
    """Equation 4, read as a similarity: mean cosine of the columns; (n,) and (m,) to (n, m), 0..1.

    The paper leaves open what an empty column's cosine is. Ours: a column that both lack is not
    counted, one that only one lacks counts with cosine 0. So s(x, x) = 1, whatever is empty.
    """
    both = x.filled @ y.filled.T
    counted = x.filled.sum(axis=1)[:, None] + y.filled.sum(axis=1) - both
    cosines: NDArray[np.float32] = x.unit @ y.unit.T
    cosines /= np.maximum(counted, np.float32(1))
    return np.minimum(cosines, np.float32(1), out=cosines)


def best_shift(
    query: Columns, templates: Columns, shifts: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Equation 6: of the given column shifts the one at which each template is most alike.

    Args:
        query: one context.
        shifts: (k,) columns, in order of preference where they tie.

    Returns:
        (n,) shift s: column j of the query meets column j + s of the template; (n,) similarity.
    """
    scores = similarity(templates, query.turned(shifts))
    best = scores.argmax(axis=1)
    return shifts[best], scores[np.arange(len(scores)), best]
