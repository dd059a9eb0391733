"""CHECK MAP: all checks of a map as it was read, in order, and the refusal of a map that has an error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import UnfitMap
from firstfix.findings.finding import Finding, Severity
from firstfix.findings.map_kinds import MAP_FEW_POINTS, MAP_FLAT

from ..read_map.map_data import MapData
from . import doubled_walls, up
from .doubled_walls import check_doubled_walls
from .precision import check_precision
from .shape import Shape
from .surfaces import surfaces
from .trajectory import check_trajectory
from .turned_trajectory import check_turned
from .unit import check_unit
from .up import check_up

MIN_POINTS = 200
MIN_HEIGHT_M = 0.4  # of a map with walls


def check_map(data: MapData, poses: NDArray[np.float64] | None = None) -> list[Finding]:
    """Findings of a map; one alone where it is an error.

    Args:
        data: the map with z up and in metres, as the build's options say.
        poses: (m, 4, 4) T_map_sensor of the mapping run, in the frame of ``data``.
    """
    found: list[Finding] = []
    for check in _checks(data, poses):
        one = check()
        if one is not None and one.severity is Severity.ERROR:
            return [one]  # what follows from it is no news
        if one is not None:
            found.append(one)
    return found


def _checks(data: MapData, poses: NDArray[np.float64] | None) -> Iterator[Callable[[], Finding | None]]:
    """The checks, the quick ones first. A mesh shows neither spacing nor doubled walls."""
    shape, points = Shape.of(data), data.points
    yield lambda: check_precision(data.coordinates + data.origin)
    if points is not None:
        yield lambda: _few_points(points)
    yield lambda: check_unit(shape)
    if points is None:
        return
    yield lambda: _flat(shape)
    if poses is not None:
        yield lambda: check_trajectory(points, poses)
        yield lambda: check_turned(points, poses, -data.origin)
    yield lambda: check_up(surfaces(points, up.VOXEL_M, up.MAX_POINTS), poses)
    yield lambda: check_doubled_walls(surfaces(points, doubled_walls.VOXEL_M, doubled_walls.MAX_POINTS))


def refuse(findings: Iterable[Finding]) -> None:
    """Refuse a map with an error among its findings.

    Raises:
        UnfitMap: with the text and the remedy of each.
    """
    errors = [one for one in findings if one.severity is Severity.ERROR]
    if errors:
        raise UnfitMap(" ".join(f"{one.text} {one.remedy}" for one in errors))


def _few_points(points: NDArray[np.float64]) -> Finding | None:
    if len(points) >= MIN_POINTS:
        return None
    return MAP_FEW_POINTS.found({"points": len(points), "needed": MIN_POINTS})


def _flat(shape: Shape) -> Finding | None:
    """Finding of a map that has extent and no height."""
    if shape.extent_m[2] >= MIN_HEIGHT_M or shape.extent_m.min() < shape.extent_m[2]:
        return None
    return MAP_FLAT.found(shape.numbers, **shape.words)
