"""Ways to level a scan that are worth a search: several ups near the measured one, and several heights.

They are compiled: ``native/include/firstfix/query/level_hypotheses.hpp``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .. import native
from .preprocess import PreparedQuery, PreparedScan


def level_hypotheses(
    prepared: PreparedQuery, expected_up: NDArray[np.float64] | None, usual_height_m: float, *, tilted: bool
) -> tuple[PreparedScan, ...]:
    """The query's scans, levelled in each way that is worth a search.

    Of a long sequence only the last scans are taken, so that the work has a limit.

    Args:
        expected_up: (3,) unit vector in the last scan's frame, by the mounting; None: up is measured, and
            only heights are varied.
        usual_height_m: of the map's own sensor above the floor, tried beside the height that the scan shows.
        tilted: also by small tilts about the likeliest ups, then with the usual height only.
    """
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
