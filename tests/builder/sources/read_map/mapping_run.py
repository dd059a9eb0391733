"""Folders with the scans of a mapping run along a street, made of points: every expectation is exact."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import from_quaternion, inverse, quaternion_of, transform_points
from firstfix_builder.sources.read_map.posed_scans import POSES
from firstfix_builder.sources.read_map.scan_folders import FOLDER

HEADER = "scan,tx,ty,tz,qx,qy,qz,qw"
SIGHT_M = 12.0
Posed = tuple[NDArray[np.float32], NDArray[np.float64]]  # scan and T_map_sensor


def street(length_m: float = 70.0) -> NDArray[np.float64]:
    """(n, 3) points of a street's ground and fronts."""
    rng = np.random.default_rng(5)
    along = rng.uniform(-12, length_m + 12, 60 * int(length_m))
    ground = np.column_stack([along, rng.uniform(-5, 5, len(along)), np.zeros(len(along))])
    fronts = np.column_stack([along, rng.choice([-5.0, 5.0], len(along)), rng.uniform(0, 4, len(along))])
    return np.concatenate([ground, fronts])


def scan_of(world: NDArray[np.float64], T_map_sensor: NDArray[np.float64]) -> NDArray[np.float32]:
    """The points in sight; nothing hides another."""
    away_m = np.linalg.norm(world - T_map_sensor[:3, 3], axis=1)
    seen = world[(away_m < SIGHT_M) & (away_m > 1.0)]
    return transform_points(inverse(T_map_sensor), seen).astype(np.float32)


def drive(count: int, step_m: float = 1.0, origin: Sequence[float] = (0, 0, 0)) -> list[Posed]:
    """Scans along the street, each turned in its own manner, in a frame whose street begins at the origin."""
    world, posed = street(count * step_m), []
    for k in range(count):
        T = from_quaternion([step_m * k, 0.5, 1.5], [0.02, -0.01, np.sin(0.3 * k), np.cos(0.3 * k)])
        scan = scan_of(world, T)
        T[:3, 3] += origin
        posed.append((scan, T))
    return posed


def write_run(source: Path, posed: Sequence[Posed], more_rows: Sequence[str] = ()) -> Path:
    """Writes a map's folder of nothing but mapping scans."""
    folder = source / FOLDER
    folder.mkdir(parents=True)
    with (folder / POSES).open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(HEADER.split(","))
        for number, (scan, T) in enumerate(posed):
            np.save(folder / name_of(number), scan)
            rows.writerow([name_of(number), *T[:3, 3].tolist(), *quaternion_of(T).tolist()])
        file.write("".join(f"{row}\n" for row in more_rows))
    return source


def name_of(number: int) -> str:
    return f"{number:03}.npy"
