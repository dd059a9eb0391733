"""Templates of a map: positions, and descriptors of the scans simulated there (paper III.A)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...descriptor import Described, Descriptor, rows_of

PREFIX = "template_"


@dataclass(frozen=True)
class Templates:
    """Templates in the index's levelled frame, n of them. Each sensor has the orientation of the frame.

    Attributes:
        position_m: (n, 3) float32 of the sensor.
        height_m: (n,) float32 of the sensor above its floor.
        described: their descriptions by the version's descriptor, n rows.
    """

    position_m: NDArray[np.float32]
    height_m: NDArray[np.float32]
    described: Described

    def __len__(self) -> int:
        return len(self.position_m)

    @cached_property
    def usual_height_m(self) -> float:
        """Median height of the sensor above its floor."""
        return float(np.median(self.height_m))

    def described_at(self, rows: NDArray[np.integer]) -> Described:
        """Descriptions of the given templates."""
        return rows_of(self.described, rows)

    def save(self, directory: Path) -> None:
        """Writes a version's files."""
        for name, array in self._arrays().items():
            np.save(directory / f"{PREFIX}{name}.npy", array)

    @classmethod
    def load(cls, directory: Path, descriptor: Descriptor) -> Templates:
        """Reads a version's files, memory-mapped: replicas on one machine share the pages.

        Raises:
            ValueError, OSError: a file is missing or damaged, or does not fit the others.
        """

        def read(name: str) -> NDArray[Any]:
            array: NDArray[Any] = np.load(directory / f"{PREFIX}{name}.npy", mmap_mode="r")
            return array

        templates = cls(
            read("position_m"), read("height_m"), {name: read(name) for name in descriptor.arrays}
        )
        for name, array in templates._arrays().items():
            if not array.ndim or len(array) != len(templates):
                raise ValueError(f"{PREFIX}{name}.npy does not have a row for each template")
        return templates

    @classmethod
    def concatenate(cls, parts: list[Templates]) -> Templates:
        """Templates of all parts, in order."""
        arrays = [part._arrays() for part in parts]
        whole = {name: np.concatenate([a[name] for a in arrays]) for name in arrays[0]}
        return cls(whole.pop("position_m"), whole.pop("height_m"), whole)

    def _arrays(self) -> Described:
        return {"position_m": self.position_m, "height_m": self.height_m, **self.described}
