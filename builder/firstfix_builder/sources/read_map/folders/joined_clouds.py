"""Clouds of several files in one frame, as one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from firstfix.errors import MalformedData

from ....mesh.intensity import joined_intensity
from ..file_errors import naming
from ..map_data import MapData
from ..map_file import read_map_file
from ..map_limits import LIMITS


def read_cloud(path: Path) -> MapData:
    """A cloud of a folder.

    Raises:
        MalformedData: it is damaged, or a mesh; the message names the file.
    """
    with naming(path):
        data = read_map_file(path)
        if data.points is None:
            raise MalformedData("it is a mesh, but a cloud is expected")
    return data


def read_clouds(paths: Iterable[Path]) -> list[MapData]:
    """Clouds that fit into memory together; raises as ``read_cloud`` does."""
    clouds: list[MapData] = []
    for path in paths:
        clouds.append(read_cloud(path))
        LIMITS.check("the clouds", sum(len(one.coordinates) for one in clouds), 8 * 3)
    return clouds


def joined(clouds: Sequence[MapData]) -> MapData:
    """Clouds in one frame and one unit as one, with what was left out of each.

    Raises:
        MalformedData: they are in several units.
    """
    first = clouds[0]
    if any(one.metres != first.metres for one in clouds):
        raise MalformedData(f"its clouds are in several units: {first.read.unit or 'metre'} and others")
    return MapData(
        points=np.concatenate([one.coordinates for one in clouds]),
        intensity=joined_intensity([one.intensity for one in clouds]),
        metres=first.metres,
        read=first.read.without(*(one for cloud in clouds[1:] for one in cloud.read.left_out)),
    )
