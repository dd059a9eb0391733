"""Interface of a descriptor, for the builder, the search, and robots that send their own."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .scan_batch import ScanBatch

Described: TypeAlias = dict[str, NDArray[Any]]
"""Description of n scans: named arrays with one row for each scan. It is stored in this form."""


class Descriptor(Protocol):
    """Method to describe scans, to find them by key, and to compare them. Pure and thread-safe.

    Attributes:
        arrays: names of the arrays that ``describe`` returns.
    """

    arrays: ClassVar[tuple[str, ...]]

    def describe(self, scans: ScanBatch) -> Described:
        """Describe n levelled scans."""
        ...

    def keys(self, described: Described) -> NDArray[np.float32]:
        """Keys, (n, d). Scans of the same place have near keys (L2), whatever their headings."""
        ...

    def similarity(self, x: Described, y: Described) -> NDArray[np.float32]:
        """Similarities, (n, m) in 0..1, of scans with the same heading: templates."""
        ...

    def match(
        self, query: Described, templates: Described, rows: NDArray[np.integer]
    ) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
        """Compare one scan with some of the templates.

        Args:
            rows: (m,) of these templates.

        Returns:
            (m,) yaw of the scan in each template's frame, radians, and (m,) score, 0..1.
        """
        ...


def rows_of(described: Described, rows: NDArray[np.integer] | slice) -> Described:
    """The given rows of every array."""
    return {name: array[rows] for name, array in described.items()}
