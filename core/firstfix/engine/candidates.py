"""Which templates look like the scan, and the pose that each implies."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..answer.options import LocalizeOptions
from ..answer.prior import Prior
from ..descriptor import Described
from ..transform import Matrix, inverse, make_transform, rotation_z, transform_points
from .index import MapIndex
from .retrieval.cascade import Matches

LEAST_A_SCAN = 3
A_SPOT = 3  # templates beside each other lead to one place: more of them would crowd out the others
SPOT_M, SPOT_DEG = 2.0, 20.0
_SPOT_COS = math.cos(math.radians(SPOT_DEG))
YAW_SLACK_DEG = 10.0  # a candidate's heading is as coarse as the descriptor's sectors


class Levelled(Protocol):
    """What the search needs of a scan beside its descriptor; see ``PreparedScan``."""

    @property
    def T_last_scan(self) -> Matrix: ...
    @property
    def R_level_sensor(self) -> NDArray[np.float64]: ...
    @property
    def height_m(self) -> float: ...


@dataclass(frozen=True)
class Candidate:
    """A template that the search proposes.

    Attributes:
        T_level_sensor: (4, 4) of the query's last scan, as the template's place and the best turn imply it.
        score: 0..1, of the two descriptors at that turn.
    """

    template: int
    T_level_sensor: Matrix
    score: float


def search(
    index: MapIndex,
    described: Sequence[Described],
    scans: Sequence[Levelled],
    options: LocalizeOptions,
    effort: int = 1,
) -> list[Candidate]:
    """Poses of the last scan that the prior allows, from the templates most like each of the scans.

    Args:
        described: each scan of the query alone.
        effort: times as many clusters and candidates as the config says.
    """
    count = options.max_candidates or effort * index.config.search.candidates
    each = max(LEAST_A_SCAN, 2 * count // len(described)) if len(described) > 1 else count
    found = [
        candidate
        for scan, one in zip(scans, described, strict=True)
        for candidate in _of_scan(index, one, scan, options.prior, each, effort)
    ]
    return sorted(found, key=lambda candidate: -candidate.score)


def _of_scan(
    index: MapIndex, described: Described, scan: Levelled, prior: Prior | None, count: int, effort: int
) -> Iterator[Candidate]:
    templates, T_scan_last = index.cascade.templates, inverse(scan.T_last_scan)
    matches = _matches(index, described, scan, prior, effort)
    # the template's floor counts, not its mount: this sensor may sit higher
    positions = np.array(templates.position_m[matches.rows], np.float64)
    positions[:, 2] += scan.height_m - templates.height_m[matches.rows]
    chosen: list[tuple[float, ...]] = []
    for row, at, yaw, score in zip(
        matches.rows, positions.tolist(), matches.yaw_rad.tolist(), matches.score, strict=True
    ):
        here = (*at, yaw)
        if sum(_leads_to_one_place(here, other) for other in chosen) >= A_SPOT:
            continue
        T_level_last = make_transform(rotation_z(yaw) @ scan.R_level_sensor, at) @ T_scan_last
        if prior is not None and not prior.allows(index.T_map_level @ T_level_last, np.inf, YAW_SLACK_DEG):
            continue
        chosen.append(here)
        yield Candidate(int(row), T_level_last, float(score))
        if len(chosen) == count:
            return


def _leads_to_one_place(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Of two x, y, z, yaw. Plain numbers: of a hundred matches each is held against a few, and arrays of
    four cost more to make than to compare."""
    return math.dist(one[:3], other[:3]) < SPOT_M and math.cos(one[3] - other[3]) > _SPOT_COS


def _matches(
    index: MapIndex, described: Described, scan: Levelled, prior: Prior | None, effort: int
) -> Matches:
    clusters = effort * index.config.search.clusters
    if prior is None:
        return index.cascade.search(described, clusters)
    centre = transform_points(inverse(index.T_map_level), prior.position_m[None])[0]
    way_m = float(np.linalg.norm(scan.T_last_scan[:3, 3]))  # the prior is about the last scan
    radius_m = prior.radius_m + way_m + index.config.spacing_m
    return index.cascade.search_near(described, centre, radius_m, clusters)
