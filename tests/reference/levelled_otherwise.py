"""The scans of a query, levelled otherwise: what ``native.MapSearch`` does within itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firstfix import native
from firstfix.engine.config import PreprocessConfig
from firstfix.engine.preprocess import PreparedQuery, PreparedScan
from firstfix.scan.levelling import levelling_rotation


def levelled_otherwise(
    prepared: PreparedQuery, expected_up: NDArray[np.float64] | None, usual_height_m: float, *, tilted: bool
) -> tuple[PreparedScan, ...]:
    """As ``tests.reference.level_hypotheses``, by the compiled function."""
    scans, dense = prepared.scans, prepared.dense
    found = native.level_hypotheses(
        [(one.T_last_scan, one.R_level_sensor, one.thinned.points, one.thinned.normals) for one in scans],
        dense.points,
        dense.normals,
        expected_up,
        usual_height_m,
        tilted,
    )
    return tuple(
        replace(scans[number], R_level_sensor=R_level_sensor, height_m=height_m, described=None)
        for number, R_level_sensor, height_m in found
    )


def with_other_ups(
    query: PreparedQuery, gravity: NDArray[np.float64] | None, config: PreprocessConfig
) -> tuple[PreparedScan, ...]:
    """Every scan, levelled by each of the other directions that may be up in the last scan."""
    last = query.scans[-1]
    known = last.T_last_scan[:3, :3] @ last.up
    ups = native.other_ups(query.dense.normals, known, gravity)
    return tuple(
        with_up(scan, scan.T_last_scan[:3, :3].T @ up, config.default_height_m)
        for up in ups
        for scan in query.scans
    )


def with_up(scan: PreparedScan, up: NDArray[np.float64], default_height_m: float) -> PreparedScan:
    """A scan levelled by another up direction, (3,) in its frame."""
    seen_m = native.height_above_floor(scan.thinned.points, scan.thinned.normals, up)
    height_m = default_height_m if seen_m is None else seen_m
    return replace(scan, R_level_sensor=levelling_rotation(up), height_m=height_m, described=None)
