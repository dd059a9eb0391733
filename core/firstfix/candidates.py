"""Which templates look like the scan, and the pose that each implies."""

from __future__ import annotations

from dataclasses import dataclass

from .descriptor import Described
from .map_index import MapIndex
from .preprocess import PreparedScan
from .transform import Matrix, make_transform, rotation_z


@dataclass(frozen=True)
class Candidate:
    """A template that the search proposes.

    Attributes:
        T_level_sensor: (4, 4) as the template's place and the best turn imply it.
        score: 0..1, of the two descriptors at that turn.
    """

    template: int
    T_level_sensor: Matrix
    score: float


def search(
    index: MapIndex, described: Described, prepared: PreparedScan, count: int | None
) -> list[Candidate]:
    """The templates most like the scan, best first.

    Args:
        described: the one scan.
        count: at most so many; None: as the version says.
    """
    config, templates = index.config.search, index.cascade.templates
    matches = index.cascade.search(described, config.clusters)
    candidates: list[Candidate] = []
    for row, yaw, score in zip(matches.rows, matches.yaw_rad, matches.score, strict=True):
        if len(candidates) == (count or config.candidates):
            break
        # the template's floor counts, not its mount: this sensor may sit higher
        position = templates.position_m[row] + [0, 0, prepared.height_m - templates.height_m[row]]
        T_level_sensor = make_transform(rotation_z(yaw) @ prepared.R_level_sensor, position)
        candidates.append(Candidate(int(row), T_level_sensor, float(score)))
    return candidates
