"""A recording as the scans of a mapping run: a folder that ``firstfix build`` makes a map of."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InvalidOption
from firstfix.transform import Matrix, quaternion_of
from firstfix_builder.read_map.mapping_scans import FOLDER
from firstfix_builder.read_map.posed_scans import POSES

from ..poses_csv import POSE_COLUMNS
from .recording import RecordedScan


def write_mapping_run(
    folder: Path, scans: Iterable[RecordedScan], voxel_m: float, max_range_m: float
) -> tuple[int, int]:
    """Writes scans below ``mapping_scans/`` of a folder while they come, and then their poses.

    Args:
        scans: in the order of time.
        voxel_m: edge of a voxel, of which a scan keeps one point.
        max_range_m: points further from their sensor are left out: errors of the poses' angles grow with it.

    Returns:
        Numbers of scans and of their points.

    Raises:
        InvalidOption: a length is no positive number.
        InputError: a scan is damaged.
    """
    for name, value in (("voxel", voxel_m), ("range", max_range_m)):
        if not 0 < value < np.inf:
            raise InvalidOption(f"the {name} must be over 0 m, not {value:g}")
    (folder / FOLDER).mkdir(parents=True)
    rows, count = [], 0
    for number, recorded in enumerate(scans):
        points = recorded.scan.points
        points = _thinned(points[np.linalg.norm(points, axis=1) <= max_range_m], voxel_m)
        name = f"{number:06}.npy"
        np.save(folder / FOLDER / name, points)
        rows.append([name, *_words(recorded.T_map_sensor)])
        count += len(points)
    with (folder / FOLDER / POSES).open("w", newline="") as file:
        csv.writer(file).writerows([["scan", *POSE_COLUMNS], *rows])
    return len(rows), count


def _words(T_map_sensor: Matrix) -> list[str]:
    """The pose to micrometres, whatever the size of its coordinates, and nine digits of its turn."""
    position, turn = T_map_sensor[:3, 3].tolist(), quaternion_of(T_map_sensor).tolist()
    return [*(f"{value:.6f}" for value in position), *(f"{value:.9f}" for value in turn)]


def _thinned(points: NDArray[np.float32], voxel_m: float) -> NDArray[np.float32]:
    cell = np.floor(points.astype(np.float64) / voxel_m).astype(np.int64)
    _, first = np.unique(cell, axis=0, return_index=True)
    return points[np.sort(first)]
