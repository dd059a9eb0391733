"""Simulator for one place of a large map, with only the tiles of the mesh that its rays can meet."""

from __future__ import annotations

import threading
from collections import OrderedDict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..mesh.tiled_mesh import TiledMesh
from .simulate import Simulator

KEPT = 2  # simulators of a process: it works on one tile after the other

_kept: OrderedDict[tuple[Path, tuple[int, ...]], Simulator] = OrderedDict()
_lock = threading.Lock()


def local_simulator(
    mesh: Path, low: NDArray[np.float64], high: NDArray[np.float64], reach_m: float
) -> Simulator:
    """Returns a simulator for rays up to reach_m that begin over the box of (2,) corners.

    All chunks of the box share it. Threads that need the same one wait until it is made.

    Args:
        mesh: folder of the finished stage.
    """
    tiled = TiledMesh.load(mesh)
    return _simulator(mesh, tiled, tiled.near(low, high, reach_m))


def whole_simulator(mesh: Path) -> Simulator:
    """Returns a simulator over the whole mesh, which all stages share.

    Args:
        mesh: folder of the finished stage.
    """
    tiled = TiledMesh.load(mesh)
    return _simulator(mesh, tiled, tuple(range(len(tiled.low))))


def _simulator(mesh: Path, tiled: TiledMesh, tiles: tuple[int, ...]) -> Simulator:
    with _lock:
        if (mesh, tiles) not in _kept:
            part = tiled.part(tiles)
            _kept[mesh, tiles] = Simulator(part.vertices, part.triangles)
        _kept.move_to_end((mesh, tiles))
        while len(_kept) > KEPT:
            _kept.popitem(last=False)
        return _kept[mesh, tiles]
