"""What a descriptor is to those who use one: the builder, the search, a robot that sends its own."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .scan_batch import ScanBatch

Described: TypeAlias = dict[str, NDArray[Any]]
"""n scans, described: named arrays, a row for every scan. As it comes, so it is stored."""


class Descriptor(Protocol):
    """How scans are described, found by key, and compared. Pure and thread-safe.

    Attributes:
        arrays: names of those that ``describe`` makes.
    """

    arrays: ClassVar[tuple[str, ...]]

    def describe(self, scans: ScanBatch) -> Described:
        """n levelled scans."""
        ...

    def keys(self, described: Described) -> NDArray[np.float32]:
        """(n, d): near each other (L2) for scans of the same place, whatever their headings."""
        ...

    def similarity(self, x: Described, y: Described) -> NDArray[np.float32]:
        """(n, m), 0..1, of scans whose frames are comparable as they are: templates."""
        ...

    def match(
        self, query: Described, templates: Described
    ) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
        """One scan against m templates: (m,) its yaw in each one's frame, radians, and (m,) score, 0..1."""
        ...


def rows_of(described: Described, rows: NDArray[np.integer] | slice) -> Described:
    """The given rows of every array."""
    return {name: array[rows] for name, array in described.items()}
