"""Simulated scans at the viewpoints, described: the templates (paper III.A)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from firstfix.descriptor import cnz, describe
from firstfix.engine_config import DescriptorConfig, Stage
from firstfix.errors import BuildCancelled
from firstfix.occupancy import occupancy, ring_spectrum
from firstfix.sensor import SensorModel
from firstfix.templates import Templates

from .simulate import Simulator

SCANS_AT_ONCE = 128


class SimulateConfig(Stage):
    """How finely templates are cast: the descriptor's cells are coarser than most sensors' rays."""

    max_rays: int = Field(16_384, ge=500, le=1_000_000)


def upright(positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, 3) to (n, 4, 4) poses with no rotation."""
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, 3] = positions
    return T


def scan_points(
    ranges: NDArray[np.float32], directions: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """(n, rays) ranges to the (p, 3) returns of all scans, and the (p,) scan each belongs to."""
    scan, ray = np.nonzero(np.isfinite(ranges))
    return directions[ray] * ranges[scan, ray][:, None], scan


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
    config: DescriptorConfig,
    executor: Executor,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> tuple[Templates, NDArray[np.float32]]:
    """Templates at (n, 3) positions, (n,) above their floors, and their (n, d) search keys.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    directions = sensor.directions()
    starts = range(0, len(positions), SCANS_AT_ONCE)
    done = 0

    def chunk(start: int) -> tuple[Templates, NDArray[np.float32]]:
        nonlocal done
        if cancelled():
            raise BuildCancelled("cancelled while simulating scans")
        here = slice(start, start + SCANS_AT_ONCE)
        made = _describe_chunk(simulator, positions[here], height_m[here], sensor, directions, config)
        done += 1
        progress(done / len(starts))
        return made

    parts = list(executor.map(chunk, starts))
    fields = Templates.__dataclass_fields__
    templates = Templates(**{name: np.concatenate([getattr(t, name) for t, _ in parts]) for name in fields})
    return templates, np.concatenate([keys for _, keys in parts])


def _describe_chunk(
    simulator: Simulator,
    positions: NDArray[np.float64],
    height_m: NDArray[np.float64],
    sensor: SensorModel,
    directions: NDArray[np.float32],
    config: DescriptorConfig,
) -> tuple[Templates, NDArray[np.float32]]:
    ranges = np.concatenate(list(simulator.ranges(upright(positions), sensor)))
    points, scan = scan_points(ranges, directions)
    height = height_m.astype(np.float32)
    described = describe(points, scan, len(positions), height, config.polar)
    filled = occupancy(points, scan, len(positions), height, config.layered)
    templates = Templates(
        position_m=positions.astype(np.float32),
        height_m=height,
        angle_rad=described.angle_rad,
        ratio=described.ratio,
        context=described.context.astype(np.float16),
        cnz=cnz(described.context),
        occupancy=np.packbits(filled.reshape(len(positions), -1), axis=1),
    )
    return templates, ring_spectrum(filled, config.coefficients)
