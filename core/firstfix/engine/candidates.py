"""Candidates: templates that resemble a scan, and the sensor pose that each implies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..answer.options import LocalizeOptions
from ..answer.prior import Prior
from ..descriptor import Described
from ..native import candidates_of
from ..transform import Matrix, inverse, transform_points
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
class Candidates:
    """Templates found by the search, with the poses that they imply, most similar first.

    Attributes:
        template: (k,) their rows.
        T_level_sensor: (k, 4, 4) of the query's last scan, from the template's position and the best yaw.
        score: (k,) 0..1, similarity of the two descriptors at that yaw.
    """

    template: NDArray[np.integer]
    T_level_sensor: NDArray[np.float64]
    score: NDArray[np.floating]

    def __len__(self) -> int:
        return len(self.template)

    def at(self, rows: NDArray[np.integer]) -> Candidates:
        """Some of the candidates, in the order of the (m,) given rows."""
        return Candidates(self.template[rows], self.T_level_sensor[rows], self.score[rows])

    @classmethod
    def merged(cls, parts: Sequence[Candidates]) -> Candidates:
        """The candidates of all parts, most similar first. No parts have none."""
        if not parts:
            return cls(np.empty(0, np.int64), np.empty((0, 4, 4)), np.empty(0))
        if len(parts) == 1:
            return parts[0]
        template, T_level_sensor, score = (
            np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)
        )
        return cls(template, T_level_sensor, score).at(np.argsort(-score, kind="stable"))


def find_candidates(
    index: MapIndex,
    described: Sequence[Described],
    scans: Sequence[LevelledScan],
    options: LocalizeOptions,
    effort: int = 1,
) -> Candidates:
    """Candidates that the prior allows, from the templates most similar to each scan, best first.

    Args:
        described: descriptor of each scan.
        effort: factor on the config's numbers of clusters and candidates.
    """
    count = options.max_candidates or effort * index.config.search.candidates
    each = max(MIN_PER_SCAN, 2 * count // len(described)) if len(described) > 1 else count
    clusters = effort * index.config.search.clusters
    return Candidates.merged(
        [
            candidates_of_scan(index, one, scan, options.prior, each, clusters)
            for scan, one in zip(scans, described, strict=True)
        ]
    )


def candidates_of_scan(
    index: MapIndex,
    described: Described,
    scan: LevelledScan,
    prior: Prior | None,
    count: int,
    clusters: int,
    per_spot: int | None = MAX_PER_SPOT,
) -> Candidates:
    """Candidates of one scan that the prior allows, best first.

    Args:
        count: at most.
        clusters: whose templates are compared, nearest by key.
        per_spot: candidates of one spot at most; None: any number.

    The template's floor counts, not its mount: this sensor may stand higher.
    """
    templates, matches = index.cascade.templates, _matches(index, described, scan, prior, clusters)
    headings = None
    if prior is not None:
        headings = index.T_map_level, prior.yaw_deg, prior.yaw_range_deg + YAW_SLACK_DEG
    found = candidates_of(
        matches.rows,
        matches.yaw_rad,
        matches.score,
        templates.position_m,
        templates.height_m,
        scan.R_level_sensor,
        scan.height_m,
        inverse(scan.T_last_scan),
        headings,
        count,
        None if per_spot is None else (SPOT_M, _SPOT_COS, per_spot),
    )
    return Candidates(*found)


def _matches(
    index: MapIndex, described: Described, scan: LevelledScan, prior: Prior | None, clusters: int
) -> Matches:
    if prior is None:
        return index.cascade.search(described, clusters)
    centre = transform_points(inverse(index.T_map_level), prior.position_m[None])[0]
    way_m = float(np.linalg.norm(scan.T_last_scan[:3, 3]))  # the prior is about the last scan
    radius_m = prior.radius_m + way_m + index.config.spacing_m
    return index.cascade.search_near(described, centre, radius_m, clusters)
