"""Simulator for one place of a large map, with only the tiles of the mesh that its rays can meet."""

from __future__ import annotations

import threading
from collections import OrderedDict
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..mesh.tiled_mesh import TiledMesh
from .simulate import Simulator

KEPT = 2  # simulators of a process: it works on one tile after the other
WHOLE_TRIANGLES = 3_000_000  # a mesh with no more is taken whole: one simulator serves all places


def local_simulator(
    mesh: Path, low: NDArray[np.float64], high: NDArray[np.float64], reach_m: float
) -> Simulator:
    """A simulator for rays up to reach_m that begin over the box of (2,) corners.

    It may hold surface that is further away. All chunks of the box share it. Threads that need the same one
    wait until it is made.

    Args:
        mesh: folder of the finished stage.
    """
    tiled = TiledMesh.load(mesh)
    if len(tiled.mesh.triangles) <= WHOLE_TRIANGLES:
        return _simulator(mesh, tuple(range(len(tiled))))
    return _simulator(mesh, tiled.near(low, high, reach_m))


def whole_simulator(mesh: Path) -> Simulator:
    """A simulator over the whole mesh, which all stages share.

    Args:
        mesh: folder of the finished stage.
    """
    return _simulator(mesh, tuple(range(len(TiledMesh.load(mesh)))))


class _Made:
    """The simulator of some tiles, made by the first thread that needs it."""

    def __init__(self, mesh: Path, tiles: tuple[int, ...]) -> None:
        self._mesh, self._tiles = mesh, tiles
        self._lock = threading.Lock()

    def get(self) -> Simulator:
        with self._lock:
            return self._simulator

    @cached_property
    def _simulator(self) -> Simulator:
        part = TiledMesh.load(self._mesh).part(self._tiles)
        return Simulator(part.vertices, part.triangles)


_kept: OrderedDict[tuple[Path, tuple[int, ...]], _Made] = OrderedDict()
_lock = threading.Lock()


def _simulator(mesh: Path, tiles: tuple[int, ...]) -> Simulator:
    with _lock:
        made = _kept.setdefault((mesh, tiles), _Made(mesh, tiles))
        _kept.move_to_end((mesh, tiles))
        while len(_kept) > KEPT:
            _kept.popitem(last=False)
    return made.get()  # without the lock: other threads make those of other tiles
