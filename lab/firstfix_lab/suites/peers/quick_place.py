"""A place for the quick suite: a small yard, with simulated scans of a mapping run and scans to ask."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.builds.config import PerturbConfig
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from tests.pose_rows import POSE, numbers_of, write_rows
from tests.recorded_data import Dataset, PoseTable

from ...common.small_map import CONFIG, SENSOR, make_small_mesh

QUICK = "small yard"
POINTS, MAPPING_SCANS, ASKED_SCANS = 60_000, 8, 4
UNIT_M = 0.001
WITHIN_M = (8.05, 6.05, 3.05)  # inner faces of the walls
SEED = 6
SLIGHTLY = PerturbConfig(occluders=0, strangers=0, unmapped=0, vanished=0)


@dataclass(frozen=True)
class SmallYard(Dataset):
    """The yard, whose build tests itself with a few scans alone."""

    @property
    def config(self) -> dict[str, Any]:
        return {**CONFIG, "viewpoints": dict(self.viewpoints)}


def make_quick_place(folder: Path) -> Dataset:
    """Write the yard as a cloud, the mapping run and the scans to ask.

    Args:
        folder: an existing one.
    """
    import trimesh

    mesh = make_small_mesh()
    points = trimesh.sample.sample_surface(mesh, POINTS, seed=SEED)[0]
    within = (np.abs(points) < WITHIN_M).all(axis=1) & (points[:, 2] > -0.01)  # no mapping run sees the rest
    np.savetxt(folder / "map.xyz", points[within], fmt="%.4f")
    simulator, sensor = Simulator(mesh.vertices, mesh.faces), SensorModel.from_mapping(SENSOR)
    x, y = np.meshgrid(np.linspace(-6, 6, 9), np.linspace(-4, 4, 7))
    spots = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, sensor.mount_height_m)])
    rng = np.random.default_rng(SEED)
    scans = perturbed_scans(simulator, sensor, spots, 0.5, MAPPING_SCANS + ASKED_SCANS, SLIGHTLY, rng)
    _write_mapping_run(folder, scans[:MAPPING_SCANS])
    rows = []
    for number, (scan, T_map_sensor) in enumerate(scans[MAPPING_SCANS:]):
        np.savetxt(folder / f"{number}.xyz", scan.points, fmt="%.4f")
        rows.append([f"{number}.xyz", *numbers_of(T_map_sensor)])
    write_rows(folder / "eval.csv", ("scan", *POSE), rows)
    return SmallYard(
        QUICK,
        ".",
        "map.xyz",
        "{}",
        {"simulation": PoseTable("eval.csv")},
        PoseTable("trajectory.csv"),
        "",
        {"spacing_m": 2.0, "max_distance_to_trajectory_m": 5.0},
        mapping_file="mapping.npz",
        mapping_unit_m=UNIT_M,
        root=folder,
    )


def _write_mapping_run(folder: Path, scans: list[tuple[Scan, Matrix]]) -> None:
    rows = [[str(number), *numbers_of(T_map_sensor)] for number, (_, T_map_sensor) in enumerate(scans)]
    write_rows(folder / "trajectory.csv", ("number", *POSE), rows)
    whole = {
        str(number): np.round(scan.points / UNIT_M).astype(np.int32) for number, (scan, _) in enumerate(scans)
    }
    np.savez(folder / "mapping.npz", **whole)
