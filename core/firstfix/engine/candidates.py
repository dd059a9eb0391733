"""Candidates: templates that resemble a scan, and the sensor pose that each implies."""

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

MIN_PER_SCAN = 3
MAX_PER_SPOT = 3  # templates of one spot lead to one pose: more of them would crowd out other spots
SPOT_M, SPOT_DEG = 2.0, 20.0
_SPOT_COS = math.cos(math.radians(SPOT_DEG))
YAW_SLACK_DEG = 10.0  # a candidate's heading is as coarse as the descriptor's sectors


class LevelledScan(Protocol):
    """The levelled frame of a scan, which the search needs beside its descriptor."""

    @property
    def T_last_scan(self) -> Matrix:
        """(4, 4) pose in the frame of the query's last scan."""
        ...

    @property
    def R_level_sensor(self) -> NDArray[np.float64]:
        """(3, 3) levelling rotation."""
        ...

    @property
    def height_m(self) -> float:
        """Height of the sensor above the floor."""
        ...


@dataclass(frozen=True)
class Candidate:
    """A template found by the search, with the pose that it implies.

    Attributes:
        template: its row.
        T_level_sensor: (4, 4) of the query's last scan, from the template's position and the best yaw.
        score: 0..1, similarity of the two descriptors at that yaw.
    """

    template: int
    T_level_sensor: Matrix
    score: float


def find_candidates(
    index: MapIndex,
    described: Sequence[Described],
    scans: Sequence[LevelledScan],
    options: LocalizeOptions,
    effort: int = 1,
) -> list[Candidate]:
    """Candidates that the prior allows, from the templates most similar to each scan, best first.

    Args:
        described: descriptor of each scan.
        effort: factor on the config's numbers of clusters and candidates.
    """
    count = options.max_candidates or effort * index.config.search.candidates
    each = max(MIN_PER_SCAN, 2 * count // len(described)) if len(described) > 1 else count
    found = [
        candidate
        for scan, one in zip(scans, described, strict=True)
        for candidate in _of_scan(index, one, scan, options.prior, each, effort)
    ]
    return sorted(found, key=lambda candidate: -candidate.score)


def _of_scan(
    index: MapIndex,
    described: Described,
    scan: LevelledScan,
    prior: Prior | None,
    count: int,
    effort: int,
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
        if sum(_is_same_spot(here, other) for other in chosen) >= MAX_PER_SPOT:
            continue
        T_level_last = make_transform(rotation_z(yaw) @ scan.R_level_sensor, at) @ T_scan_last
        if prior is not None and not prior.allows(index.T_map_level @ T_level_last, np.inf, YAW_SLACK_DEG):
            continue
        chosen.append(here)
        yield Candidate(int(row), T_level_last, float(score))
        if len(chosen) == count:
            return


def _is_same_spot(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Returns whether two (x, y, z, yaw) lead to one pose.

    Plain numbers are faster here: each of a hundred matches is compared with a few, and small arrays cost
    more to make than to compare.
    """
    return math.dist(one[:3], other[:3]) < SPOT_M and math.cos(one[3] - other[3]) > _SPOT_COS


def _matches(
    index: MapIndex, described: Described, scan: LevelledScan, prior: Prior | None, effort: int
) -> Matches:
    clusters = effort * index.config.search.clusters
    if prior is None:
        return index.cascade.search(described, clusters)
    centre = transform_points(inverse(index.T_map_level), prior.position_m[None])[0]
    way_m = float(np.linalg.norm(scan.T_last_scan[:3, 3]))  # the prior is about the last scan
    radius_m = prior.radius_m + way_m + index.config.spacing_m
    return index.cascade.search_near(described, centre, radius_m, clusters)
