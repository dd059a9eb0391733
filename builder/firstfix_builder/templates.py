"""Simulated scans at the viewpoints, described: the templates (paper III.A)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Descriptor, ScanBatch
from firstfix.errors import BuildCancelled
from firstfix.sensor import SensorModel
from firstfix.templates import Templates

from .simulate import Simulator

SCANS_AT_ONCE = 128


def upright(positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, 3) to (n, 4, 4) poses with no rotation."""
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, 3] = positions
    return T


def scan_batch(
    ranges: NDArray[np.float32], directions: NDArray[np.float32], height_m: NDArray[np.floating]
) -> ScanBatch:
    """(n, rays) ranges of upright sensors, (n,) above their floors, to the returns of all scans."""
    seen = np.isfinite(ranges)
    scan, ray = np.nonzero(seen)
    start = np.concatenate([[0], np.cumsum(seen.sum(axis=1))])
    return ScanBatch(directions[ray] * ranges[scan, ray][:, None], start, height_m.astype(np.float32))


def view_distance_m(simulator: Simulator, positions: NDArray[np.floating], sensor: SensorModel) -> float:
    """How far one sees here: of the furthest return in every direction, the 75th percentile.

    The furthest of a column of beams: the nearer ones mostly show the floor. Measured at up to 200
    viewpoints.
    """
    chosen = positions[:: max(1, len(positions) // 200)]
    probe = sensor.coarser(4000)
    directions = probe.directions()
    horizontal = np.linalg.norm(directions[:, :2], axis=1)
    furthest = []
    for ranges in simulator.ranges(upright(chosen), probe):
        away = np.where(np.isfinite(ranges), ranges * horizontal, 0).reshape(
            len(ranges), len(probe.elevations_deg), -1
        )
        furthest.append(away.max(axis=1).ravel())
    seen = np.concatenate(furthest)
    seen = seen[seen > 0]
    return float(np.percentile(seen, 75)) if len(seen) else sensor.max_range_m


def make_templates(
    simulator: Simulator,
    positions: NDArray[np.float64],
    height_m: NDArray[np.float64],
    sensor: SensorModel,
    descriptor: Descriptor,
    executor: Executor,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> Templates:
    """Templates at (n, 3) positions, (n,) above their floors.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    directions = sensor.directions()
    starts = range(0, len(positions), SCANS_AT_ONCE)
    done = 0

    def chunk(start: int) -> Templates:
        nonlocal done
        if cancelled():
            raise BuildCancelled("cancelled while simulating scans")
        here = slice(start, start + SCANS_AT_ONCE)
        ranges = np.concatenate(list(simulator.ranges(upright(positions[here]), sensor)))
        scans = scan_batch(ranges, directions, height_m[here])
        made = Templates(positions[here].astype(np.float32), scans.height_m, descriptor.describe(scans))
        done += 1
        progress(done / len(starts))
        return made

    return Templates.concatenate(list(executor.map(chunk, starts)))
