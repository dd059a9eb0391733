"""CHECK MAP: all checks of a map as it was read, in order, and the refusal of a map that has an error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import UnfitMap
from firstfix.findings.finding import Finding, Severity
from firstfix.findings.map_kinds import (
    MAP_FEW_POINTS,
    MAP_FLAT,
    MAP_NO_GROUND,
    MAP_NOT_LEVEL,
    MAP_SINGLE_SCAN,
    TRAJECTORY_LEANS,
    TRAJECTORY_LEFT_OUT,
)

from ..read_map.map_data import MapData
from . import up
from .base_poses import check_base_poses
from .doubled_floors import check_doubled_floors
from .doubled_walls import check_doubled_walls
from .floors_under import FloorsUnder
from .leaning_trajectory import check_lean
from .map_places import MapPlaces
from .no_ground import check_ground
from .precision import check_precision
from .shape import Shape
from .single_scan import check_single_scan
from .surfaces import surfaces
from .trajectory import check_trajectory
from .turned_trajectory import check_turned
from .unit import check_unit
from .up import check_up
from .upright_poses import check_upright

MIN_POINTS = 200
MIN_HEIGHT_M = 0.4  # of a map with walls
BeforeWarnings: TypeAlias = Callable[[Sequence[Finding], Shape], None]


def check_map(
    data: MapData,
    poses: NDArray[np.float64] | None = None,
    before_warnings: BeforeWarnings = lambda found, shape: None,
) -> list[Finding]:
    """Findings of a map; one alone where it is an error.

    Args:
        data: the map with z up and in metres, as the build's options say.
        poses: (m, 4, 4) T_map_sensor of the mapping run, in the frame of ``data``.
        before_warnings: called with the findings so far and the map's rough figures, before the check that
            takes as long as all others. It only warns: what refuses a map or holds it back is known by then.
    """
    found: list[Finding] = []
    for check in _checks(data, poses, found, before_warnings):
        one = check()
        if one is not None and one.severity is Severity.ERROR:
            return [one]  # what follows from it is no news
        if one is not None:
            found.append(one)
    return found


def has_fit_poses(findings: Iterable[Finding]) -> bool:
    """Whether the poses of a map with these findings are used: some that come with a map are none."""
    return all(one.code != TRAJECTORY_LEFT_OUT.code for one in findings)


def _checks(
    data: MapData,
    poses: NDArray[np.float64] | None,
    found: Sequence[Finding],
    before_warnings: BeforeWarnings,
) -> Iterator[Callable[[], Finding | None]]:
    """The checks, the quick ones first; ``found`` grows meanwhile. A mesh has neither spacing nor layers."""
    shape, points, origin = Shape.of(data), data.points, data.origin
    yield lambda: check_precision(data.coordinates + origin)
    if points is not None:
        yield lambda: _few_points(points)
    yield lambda: check_unit(shape)
    if points is None:
        return
    yield lambda: _flat(shape)
    if poses is not None:
        is_given, given = data.trajectory_source == "given", poses
        yield lambda: check_trajectory(points, given, is_given=is_given)
        poses = given if has_fit_poses(found) else None
    if poses is not None:
        stand = poses
        yield lambda: check_upright(stand)
        yield lambda: check_turned(points, given, -origin)
    yield lambda: check_up(surfaces(points, up.VOXEL_M, up.MAX_POINTS), poses)
    if all(one.code != MAP_NOT_LEVEL.code for one in found):  # these checks look along z
        yield lambda: check_single_scan(points, poses, origin)
        if all(one.code != MAP_SINGLE_SCAN.code for one in found):  # it has few floors
            yield from _of_heights(points, poses, shape, origin, found)
    before_warnings(found, shape)
    yield lambda: check_doubled_walls(points, origin)


def _of_heights(
    points: NDArray[np.float64],
    poses: NDArray[np.float64] | None,
    shape: Shape,
    origin: NDArray[np.float64],
    found: Sequence[Finding],
) -> Iterator[Callable[[], Finding | None]]:
    """The checks of floors, and of the poses over them."""
    places = MapPlaces.of(points)
    if not len(places.at):
        return  # too thin to tell of heights
    under = None if poses is None else FloorsUnder.of(points, poses)
    yield lambda: check_ground(under, places, origin)
    if any(one.code == MAP_NO_GROUND.code for one in found):
        return
    if under is not None:
        over = under
        yield lambda: check_lean(over, origin)
        if any(one.code == TRAJECTORY_LEANS.code for one in found):
            poses = None  # its heights tell nothing
        else:
            yield lambda: check_base_poses(over)
    yield lambda: check_doubled_floors(points, poses, places, shape.spacing_m or 0.0, origin)


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
