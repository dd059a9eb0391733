"""Share of the space around a place that the mapping run never saw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.verification.seen_free import SeenFree
from firstfix.sensor import SensorModel

from ..index.carve import BACK_OFF_M
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright

REACH_M = 4.0  # farther away, a robot in a well mapped room looks through doors into others
STEP_M = 0.5  # along a ray
RAYS = 128
_SEED = 0
_CELLS_APART = 2 * 3**0.5  # at most, from a map point to a place in a cell beside its own


def never_seen(
    seen_free: SeenFree, simulator: Simulator, sensor: SensorModel, positions_m: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Shares, 0..1, of the space around sensor positions that the mapping run never saw.

    Space counts along some of the sensor's rays, up to REACH_M and to their ends. Near a surface it does not:
    such cells are never kept as seen free. Nor do rays count that end nowhere, such as those into the sky,
    because only rays with an end carve.

    Args:
        positions_m: (n, 3) in the index's levelled frame.

    Returns:
        (n,) shares; nan where there is no such space.
    """
    rays = _some_rays(sensor)
    near_m = max(BACK_OFF_M, _CELLS_APART * float(seen_free.cell.item()))
    along_m = np.arange(STEP_M, REACH_M, STEP_M, dtype=np.float32)
    origins = positions_m.astype(np.float32)
    shares: list[float] = []
    for several in simulator.ranges(upright(positions_m), sensor, rays):
        for ranges in several:
            until_m = np.where(np.isfinite(ranges), ranges, 0) - np.float32(BACK_OFF_M)
            ray, step = np.nonzero(along_m < until_m[:, None])
            around = origins[len(shares)] + rays.directions[ray] * along_m[step, None]
            around = np.ascontiguousarray(around[simulator.is_free(around, near_m)])
            known = len(around) > 0
            shares.append(1 - float(seen_free.shares(around, np.eye(4)[None])[0]) if known else np.nan)
    return np.array(shares, np.float64)


def _some_rays(sensor: SensorModel) -> Rays:
    """Rays by chance: whole beams would show the space in stripes."""
    directions = Rays.at_any_heading(sensor).directions
    chosen = np.random.default_rng(_SEED).permutation(len(directions))[:RAYS]
    return Rays.of(directions[np.sort(chosen)])
