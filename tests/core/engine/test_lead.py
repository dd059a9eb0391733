"""The lead of one place over another: what stands all around counts, one thing does not."""

from __future__ import annotations

import numpy as np

from firstfix.engine.config import RegistrationConfig
from firstfix.engine.known_aliases import are_parted
from firstfix.engine.lead import lead_t
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix_builder.mesh.mesh import Mesh
from tests.builder.box_scenes import box, floor, sampled, walls

APART_M = 20.0  # of two rooms of one plan
MIDDLE = np.array([4.0, 3.0, 1.0])
DESKS = [(1.0, 1.0), (6.5, 1.0), (1.0, 4.5), (6.5, 4.5), (3.6, 0.6), (3.6, 5.0)]


def room(x_m: float, desks: list[tuple[float, float]]) -> list[Mesh]:
    things = [box((x_m + x, y, 0), (x_m + x + 0.6, y + 0.6, 0.9)) for x, y in desks]
    return [floor(x_m, 0, x_m + 8, 6), *walls(x_m, 0, x_m + 8, 6), *things]


def points_of(parts: list[Mesh], seed: int) -> np.ndarray:
    return sampled(Mesh.joined(parts), 200, np.random.default_rng(seed))


def t_of_the_first_room(first: list[tuple[float, float]], other: list[tuple[float, float]]) -> float:
    """Of a scan of the first room, over the other one."""
    mapped = points_of([*room(0, first), *room(APART_M, other)], 0)
    surface = MapSurface.of(Surface.around(mapped), RegistrationConfig(map_voxel_m=0.1))
    scan = points_of(room(0, first), 1).astype(np.float32)
    (t,) = lead_t(surface, [scan, scan + np.float32([APART_M, 0, 0])], MIDDLE).tolist()
    return t


def test_furniture_all_around_parts_two_rooms():
    moved = [(x + 0.7, y) for x, y in DESKS]
    assert t_of_the_first_room(DESKS, moved) > 2.5


def test_one_desk_does_not_part_two_rooms():
    assert 0 < t_of_the_first_room(DESKS, [(2.6, 1.0), *DESKS[1:]]) < 2.5


def test_equal_rooms_lead_by_nothing():
    assert abs(t_of_the_first_room(DESKS, DESKS)) < 1


def test_a_better_other_room_has_a_negative_lead():
    mapped = points_of([*room(0, []), *room(APART_M, DESKS)], 0)
    surface = MapSurface.of(Surface.around(mapped), RegistrationConfig(map_voxel_m=0.1))
    scan = points_of(room(0, DESKS), 1).astype(np.float32)
    (t,) = lead_t(surface, [scan, scan + np.float32([APART_M, 0, 0])], MIDDLE).tolist()
    assert t < -1


def test_rooms_above_each_other_are_never_told_apart():
    mapped = points_of([*room(0, DESKS), *room(APART_M, [])], 0)
    above = mapped[mapped[:, 0] > APART_M - 1] - [APART_M, 0, 0] + [0, 0, 4]
    surface = MapSurface.of(
        Surface.around(np.concatenate([mapped, above])), RegistrationConfig(map_voxel_m=0.1)
    )
    scan = points_of(room(0, DESKS), 1).astype(np.float32)
    offsets_m = np.float32([[0, 0, 0], [APART_M, 0, 0], [0, 0, 4]])
    placed_m = [scan + offset_m for offset_m in offsets_m]
    assert are_parted(surface, MIDDLE + offsets_m, placed_m).tolist() == [True, False]
