"""A map of a recording: its scans at their true poses, thinned, with the poses as the mapping run."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InvalidOption
from firstfix.transform import quaternion_of, transform_points

from .recording import RecordedScan

_MERGED = 20  # scans between two thinnings: bounds the memory by the map and these
_POINT = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8")])  # UTM coordinates need 64 bits


def map_points(scans: Iterable[RecordedScan], voxel_m: float, max_range_m: float) -> NDArray[np.float64]:
    """Merges scans to (n, 3) points in the map frame: of each voxel the point that came first.

    Args:
        voxel_m: edge of a voxel.
        max_range_m: points further from their sensor are left out: errors of the poses' angles grow with it.

    Raises:
        InvalidOption: a length is no positive number.
        InputError: a scan is damaged.
    """
    for name, value in (("voxel", voxel_m), ("range", max_range_m)):
        if not 0 < value < np.inf:
            raise InvalidOption(f"the {name} must be over 0 m, not {value:g}")
    merged = np.empty((0, 3))
    fresh: list[NDArray[np.float64]] = []
    for recorded in scans:
        points = recorded.scan.points
        near = points[np.linalg.norm(points, axis=1) <= max_range_m]
        fresh.append(_thinned(transform_points(recorded.T_map_sensor, near), voxel_m))
        if len(fresh) == _MERGED:
            merged = _thinned(np.concatenate([merged, *fresh]), voxel_m)
            fresh = []
    return _thinned(np.concatenate([merged, *fresh]), voxel_m)


def write_map(folder: Path, points: NDArray[np.float64], poses: NDArray[np.float64]) -> None:
    """Writes ``map.ply`` and ``trajectory.txt`` (TUM) to a folder, which ``firstfix build`` takes.

    Args:
        points: (n, 3) in the map frame.
        poses: (m, 4, 4) T_map_sensor, in the order of time.
    """
    rows = np.ascontiguousarray(points).view(_POINT).reshape(-1)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    (folder / "map.ply").write_bytes(header.encode() + rows.tobytes())
    lines = [
        " ".join(f"{value:.9g}" if k > 3 else f"{value:.6f}" for k, value in enumerate(_tum(number, T)))
        for number, T in enumerate(poses)
    ]
    (folder / "trajectory.txt").write_text("\n".join(lines) + "\n")


def _tum(number: int, T: NDArray[np.float64]) -> list[float]:
    return [float(number), *T[:3, 3].tolist(), *quaternion_of(T).tolist()]


def _thinned(points: NDArray[np.float64], voxel_m: float) -> NDArray[np.float64]:
    _, first = np.unique(np.floor(points / voxel_m).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]
