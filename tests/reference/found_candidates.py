"""Candidates of scans, step by step: the search within ``native.MapSearch`` is held against it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.descriptor import Described
from firstfix.engine.candidates import Candidates, LevelledScan
from firstfix.engine.index import MapIndex
from firstfix.engine.retrieval.cascade import Matches
from firstfix.native import candidates_of
from firstfix.transform import inverse, transform_points

MIN_PER_SCAN = 3
MAX_PER_SPOT = 3  # templates of one spot lead to one pose: more of them would crowd out other spots
SPOT_M, SPOT_DEG = 2.0, 20.0
_SPOT_COS = math.cos(math.radians(SPOT_DEG))
YAW_SLACK_DEG = 10.0  # a candidate's heading is as coarse as the descriptor's sectors


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
    among: NDArray[np.int64] | None = None,
) -> Candidates:
    """Candidates of one scan that the prior allows, best first.

    Args:
        count: at most.
        clusters: whose templates are compared, nearest by key.
        per_spot: candidates of one spot at most; None: any number.
        among: ascending rows of the only templates that count; None: all do.

    The template's floor counts, not its mount: this sensor may stand higher.
    """
    templates, matches = index.cascade.templates, _matches(index, described, scan, prior, clusters)
    if among is not None:
        matches = Matches(
            *(
                column[np.isin(matches.rows, among)]
                for column in (matches.rows, matches.yaw_rad, matches.score)
            )
        )
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
