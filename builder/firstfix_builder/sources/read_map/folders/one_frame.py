"""Several clouds in a folder: parts of one map in one frame, or scans in frames of their own.

Nothing in the files says which. Scans lie around the origin of their own frame, where the sensor stood;
parts of a map lie beside each other. Where both may be, it is asked.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import UnsupportedFormat

from ..map_data import MapData
from ..stations import why_no_station
from ..what_was_read import LeftOut
from .joined_clouds import joined, read_clouds

MAX_APART_M = 50.0  # between parts of one map
# FAST-LIO with pcd_save/interval: points of the world frame; the last ones are in scans.pcd
# (hku-mars/FAST_LIO, src/laserMapping.cpp).
_INTERVAL = re.compile(r"scans_(\d+)\.pcd")
_ASK = (
    "If they are scans, give them in mapping_scans/ with a poses.csv. If they are runs of one place, or "
    "share a frame, list them in a sessions.yaml (docs/how-to/my-map.md)"
)


def intervals_in(path: Path) -> list[Path]:
    """Files that FAST-LIO saves by intervals, in their order; nothing of any other folder."""
    found = {int(match[1]): file for file in path.iterdir() if (match := _INTERVAL.fullmatch(file.name))}
    rest = path / "scans.pcd"
    files = [found[number] for number in sorted(found)]
    return [*files, rest] if files and rest.is_file() else files


def read_intervals(path: Path) -> MapData:
    """The map that FAST-LIO saved by intervals; raises as ``read_parts_of_map`` does, but never asks."""
    files = intervals_in(path)
    data = _told(joined(read_clouds(files)), "FAST-LIO's folder", files)
    numbers = {int(match[1]) for file in files if (match := _INTERVAL.fullmatch(file.name))}
    missing = max(numbers) - min(numbers) + 1 - len(numbers)
    first = next(number for number in count(min(numbers)) if number not in numbers)
    gap = LeftOut("intervals", f"not there, as scans_{first}.pcd, though later ones are", missing)
    return replace(data, read=data.read.without(gap))


def read_parts_of_map(files: Sequence[Path]) -> MapData:
    """Clouds that are parts of one map.

    Raises:
        UnsupportedFormat: they may be scans in frames of their own, or lie far apart.
        MalformedData: one is damaged, or a mesh; the message names it.
        TooLarge: over the limits.
    """
    clouds = read_clouds(files)
    around = sum(not why_no_station(one.coordinates) for one in clouds)
    if around > len(clouds) / 2:
        raise UnsupportedFormat(
            f"the folder has {len(files)} map files instead of one, and {around} of them lie around the "
            f"origin, as scans in frames of their own do. {_ASK}"
        )
    apart = _furthest_part(clouds)
    if apart is not None:
        raise UnsupportedFormat(
            f"the folder has {len(files)} map files instead of one, and {files[apart].name} lies over "
            f"{MAX_APART_M:.0f} m from the others. {_ASK}"
        )
    return _told(joined(clouds), f"{len(files)} clouds in one frame", files)


def _told(data: MapData, form: str, files: Sequence[Path]) -> MapData:
    return replace(data, read=replace(data.read, form=form, clouds=tuple(file.name for file in files)))


def _furthest_part(clouds: Sequence[MapData]) -> int | None:
    """Number of a cloud that no chain of neighbours joins with the first; None: all are joined."""
    low = np.array([one.coordinates.min(axis=0) * one.metres[0] for one in clouds])
    high = np.array([one.coordinates.max(axis=0) * one.metres[0] for one in clouds])
    reached: NDArray[np.bool_] = np.zeros(len(clouds), bool)
    reached[0] = True
    todo = [0]
    while todo:
        one = todo.pop()
        gap = np.maximum(low - high[one], low[one] - high).max(axis=1)
        near = (gap <= MAX_APART_M) & ~reached
        reached |= near
        todo += np.flatnonzero(near).tolist()
    return None if reached.all() else int(np.argmin(reached))
