"""Which templates look like the scan, and the pose that each implies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .map_index import MapIndex
from .occupancy import best_shifts, occupancy, ring_spectrum
from .preprocess import PreparedScan
from .transform import Matrix, make_transform, rotation_z


@dataclass(frozen=True)
class Candidate:
    """A template that the search proposes.

    Attributes:
        T_level_sensor: (4, 4) as the template's place and the best turn imply it.
        score: 0..1, cosine of the two descriptors at that turn (docs/method.md 3.3).
    """

    template: int
    T_level_sensor: Matrix
    score: float


def describe_scan(index: MapIndex, prepared: PreparedScan) -> NDArray[np.bool_]:
    """(rows, sectors) layered occupancy of the levelled scan (docs/method.md 3.1)."""
    height_m = np.array([prepared.height_m], np.float32)
    of_scan = np.zeros(len(prepared.points), np.intp)
    filled = occupancy(prepared.points, of_scan, 1, height_m, index.config.descriptor.layered)
    return filled.reshape(filled.shape[1:])


def search(
    index: MapIndex, described: NDArray[np.bool_], prepared: PreparedScan, count: int | None
) -> list[Candidate]:
    """Nearest by key, ranked again by the best turn of the full descriptor; best first.

    Args:
        count: at most so many; None: as the version says.
    """
    config, templates = index.config, index.templates
    key = ring_spectrum(described[None], config.descriptor.coefficients)[0]
    rows = np.sort(index.keys.search(key, config.search.by_key))
    shift, score = best_shifts(described, templates.layers(rows, config.descriptor.layered))
    best = np.argsort(-score, kind="stable")[: count or config.search.candidates]
    candidates = []
    for row, turn, s in zip(
        rows[best], shift[best] * (2 * np.pi / config.descriptor.sectors), score[best], strict=True
    ):
        # the template's floor counts, not its mount: this sensor may sit higher
        position = templates.position_m[row] + [0, 0, prepared.height_m - templates.height_m[row]]
        T_level_sensor = make_transform(rotation_z(turn) @ prepared.R_level_sensor, position)
        candidates.append(Candidate(int(row), T_level_sensor, float(s)))
    return candidates
