"""Held-out scans of a built world, perturbed, and where they were taken: made once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import PerturbConfig
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.simulation.local_simulator import local_simulator
from firstfix_builder.simulation.perturb import perturbed_scans

from .build import Built

SEED = 77  # another than the self-test's and the learned keys'
REACH_M = 5.0  # that a scan is from its template


def take_scans(built: Built, work: Path, count: int) -> Path:
    """An NPZ file of ``T`` (n, 4, 4) in the map's frame, and the points of every scan by its number."""

    def produce(out: Path) -> None:
        at_m = np.load(built.version / "template_position_m.npy", mmap_mode="r")
        rng = np.random.default_rng(SEED)
        taken: list[tuple[Scan, Matrix]] = []
        while len(taken) < count:
            place = at_m[rng.integers(len(at_m))][None].astype(np.float64)
            sensor = built.config.sensor_model
            here = local_simulator(
                built.mesh.directory, place[0, :2] - REACH_M, place[0, :2] + REACH_M, sensor.max_range_m
            )
            taken += perturbed_scans(
                here, sensor, place, built.spacing_m, 1, PerturbConfig(unmapped=0, vanished=0), rng
            )
        points = {str(number): scan.points for number, (scan, _) in enumerate(taken)}
        np.savez(out / "scans.npz", T=np.array([T for _, T in taken]), **points)

    inputs = {"mesh": built.mesh.digest, "templates": built.templates.digest}
    cache = StageCache(work)
    return cache.run("scale_queries", inputs, {"count": count}, produce).directory / "scans.npz"


def read_scans(path: Path) -> tuple[list[Scan], NDArray[np.float64]]:
    """Read the file of ``take_scans``: scans, and (n, 4, 4) T_map_sensor."""
    data = np.load(path)
    T: NDArray[np.float64] = data["T"]
    return [Scan(data[str(number)]) for number in range(len(T))], T


def in_level_frame(T_map_level: Matrix, T: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) of the index's frame."""
    level: NDArray[np.float64] = np.linalg.inv(T_map_level) @ T
    return level
