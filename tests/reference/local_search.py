"""Local search: a better alignment within a few metres of a place (docs/method.md section 7.2).

Alignment brings a pose to the right minimum from a quarter of a metre, while templates stand up to two metres
apart. So the best place may be a wrong minimum beside the right one: the next panel, or the next parked car.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix import native
from firstfix.engine.config import NearbyConfig
from firstfix.engine.preprocess import PreparedQuery
from firstfix.engine.registration.align import MapSurface, Registration


def offsets_around(config: NearbyConfig) -> NDArray[np.float64]:
    """Offsets (k, 2), in metres, of starts all around a place."""
    line = np.arange(-config.reach_m, config.reach_m + config.step_m / 2, config.step_m)
    x, y = np.meshgrid(line, line)
    far_m = np.hypot(x, y)
    is_start = (far_m > 0) & (far_m <= config.reach_m + 1e-9)
    return np.column_stack([x[is_start], y[is_start]])


def offsets_along(config: NearbyConfig, registration: Registration) -> NDArray[np.float64]:
    """Offsets (k, 2), in metres, of starts along the level direction that the scan constrains least."""
    information = registration.information + np.eye(6)  # of a scan that constrains nothing
    direction = np.linalg.eigh(np.linalg.inv(information)[3:5, 3:5])[1][:, 1]
    line = np.arange(config.step_m, config.reach_m + config.step_m / 2, config.step_m)
    return np.concatenate([-line, line])[:, None] * direction


def best_near(
    surface: MapSurface,
    query: PreparedQuery,
    registration: Registration,
    offsets_m: NDArray[np.float64],
    config: NearbyConfig,
) -> Registration | None:
    """The best alignment from starts beside an aligned pose, or None: none is better than the pose itself.

    All starts are aligned with few points, deskewed by the pose's motion, the best few and the pose itself
    with many.

    Args:
        offsets_m: (k, 2) of the starts, in the level frame.
    """
    starts = np.repeat(registration.T_level_sensor[None], len(offsets_m) + 1, axis=0)
    starts[1:, :2, 3] += offsets_m
    few = query.sparse.at_most(config.points, surface.config.map_voxel_m)
    aligned = surface.align(few.deskewed(registration.twist), starts)
    score = aligned.alignment_score
    best = 1 + np.argsort(-score[1:], kind="stable")
    own_first = np.concatenate([[0], best[score[best] > score[0] - config.worse_by]])
    apart = native.distinct_poses(
        aligned.T_level_sensor[own_first], config.apart_m, np.radians(config.apart_deg), config.refined + 1
    )
    best = own_first[apart[1:]]  # the first is the place itself, where some of the starts end too
    if not len(best):
        return None
    own = registration.T_level_sensor[None]
    twist = None if registration.twist is None else np.tile(registration.twist, (1 + len(best), 1))
    refined = surface.align_fine(
        query.dense, np.concatenate([own, aligned.T_level_sensor[best]]), twist=twist
    )
    found = refined[int(np.argmax(refined.alignment_score))]
    return found if found.alignment_score > refined.alignment_score[0] + config.better_by else None
