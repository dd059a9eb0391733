"""A recording as the scans of a mapping run: a folder that ``firstfix build`` makes a map of."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from firstfix.errors import InvalidOption
from firstfix.scan.reduction import first_in_voxel, within_range
from firstfix.transform import Matrix, quaternion_of
from firstfix_builder.sources.read_map.posed_scans import POSES
from firstfix_builder.sources.read_map.scan_folders import FOLDER
from firstfix_cli.poses_csv import POSE_COLUMNS

from .recording import RecordedScan

MAX_VOXELS = 2**20 - 1  # from the sensor to the furthest point: ``first_in_voxel`` takes twice as many


def write_mapping_run(
    folder: Path, scans: Iterable[RecordedScan], voxel_m: float, max_range_m: float
) -> tuple[int, int]:
    """Write scans below ``mapping_scans/`` of a folder while they come, and then their poses.

    Args:
        scans: in the order of time.
        voxel_m: edge of a voxel, of which a scan keeps one point.
        max_range_m: points further from their sensor are left out: errors of the poses' angles grow with it.

    Returns:
        Numbers of scans and of their points.

    Raises:
        InvalidOption: a length is no positive number, or the voxel far too small for the range.
        InputError: a scan is damaged.
    """
    for name, value in (("voxel", voxel_m), ("range", max_range_m)):
        if not 0 < value < np.inf:
            raise InvalidOption(f"the {name} must be over 0 m, not {value:g}")
    if max_range_m > MAX_VOXELS * voxel_m:
        raise InvalidOption(f"a voxel of {voxel_m:g} m is too small for a range of {max_range_m:g} m")
    (folder / FOLDER).mkdir(parents=True)
    rows, count = [], 0
    for number, recorded in enumerate(scans):
        points = within_range(recorded.scan.points, 0.0, max_range_m)
        points = points[first_in_voxel(points, voxel_m)]
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
