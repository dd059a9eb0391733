"""Floor that the mapping run saw, and how much of it has no template because no step reaches it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LEFT_OUT_FILE, FLOOR_FILE = "left_out.npy", "floor.json"


@dataclass(frozen=True)
class SeenFloor:
    """The floor that the mapping run saw.

    Attributes:
        seen_m2: its area.
        without_template: share that has no template, because no step reaches it.
        left_out: (k, 3) places of that share, in the index's levelled frame.
    """

    seen_m2: float
    without_template: float
    left_out: NDArray[np.float64]

    def to_mapping(self) -> dict[str, float]:
        """The figures as JSON values."""
        return {"seen_m2": self.seen_m2, "without_template": self.without_template}

    @classmethod
    def load(cls, directory: Path) -> SeenFloor | None:
        """Read it from the folder of viewpoints; None: the map has no trajectory."""
        path = directory / FLOOR_FILE
        if not path.exists():
            return None
        return cls(**json.loads(path.read_text()), left_out=np.load(directory / LEFT_OUT_FILE))
