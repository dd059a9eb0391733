"""A factory hall: aisle after aisle of the same shelving, and the few things that tell them apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import preset
from firstfix_builder.mesh.mesh import Mesh

from .drive import smoothed
from .place import Place
from .primitives import Opening, block, box, cylinder, gable, lying, placed, wall
from .props import cabinet, chair, conveyor, desk, forklift, machine, pallet, table, tank

BAY_M, RACK_DEPTH_M, LEVELS_M = 2.7, 1.1, (0.1, 1.75, 3.4, 5.05)
WEST_LANE_M, CROSS_LANE_M, EAST_LANE_M = 4.6, 3.2, 3.8
EAVES_M, ROOF_M = 7.5, 2.0


def factory(rng: np.random.Generator) -> Place:
    """About 60 x 40 m: six or seven double rows of racks in the west, machines in the east."""
    length, width = 60 + rng.uniform(-3, 3), 40 + rng.uniform(-2, 2)
    rows = int((width - 3) / 5.2)
    west_bays, east_bays = (int(n) for n in rng.integers(5, 7, 2))
    pitch = (width - 3.0) / rows
    row_y = np.asarray(1.5 + pitch * (np.arange(rows) + 0.5), np.float64)
    aisle_y = np.concatenate([[1.5], (row_y[1:] + row_y[:-1]) / 2, [width - 1.5]])
    cross_x = WEST_LANE_M + west_bays * BAY_M + CROSS_LANE_M / 2
    racks_end = cross_x + CROSS_LANE_M / 2 + east_bays * BAY_M
    shop_x = racks_end + EAST_LANE_M  # where the production begins

    lanes_x = (WEST_LANE_M / 2, cross_x, racks_end + EAST_LANE_M / 2, (shop_x + length) / 2)

    path = _path(aisle_y, lanes_x)
    place = Place(preset("os1-64"), path, voxel_m=0.1, stride_m=0.6, corner_m=0.6)
    _shell(place, rng, length, width)
    _roof(place, rng, length, width)
    _pillars(place, np.arange(6.0, length - 3, 12.0), row_y[1::2])
    for y in row_y:
        _double_row(place, rng, WEST_LANE_M, y, west_bays)
        _double_row(place, rng, cross_x + CROSS_LANE_M / 2, y, east_bays)
    _production(place, rng, shop_x, length, width)
    _floor_goods(place, rng, aisle_y, (WEST_LANE_M, racks_end), cross_x, shop_x)
    return place


def _shell(place: Place, rng: np.random.Generator, length: float, width: float) -> None:
    """Floor, walls with doors and gates standing back in them, the columns of the frame."""
    place.fix(block([-0.3, -0.3, -0.2], [length + 0.3, width + 0.3, 0.0]))
    corners = np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])
    for k, doors in enumerate((4, 2, 5, 1)):
        a, b = corners[k], corners[(k + 1) % 4]
        along = float(np.hypot(*(b - a)))
        forward = (b - a) / along
        inward = np.array([-forward[1], forward[0]])
        yaw = float(np.arctan2(forward[1], forward[0]))
        starts = (np.arange(doors) + rng.uniform(0.2, 0.7, doors)) * along / doors
        openings = [
            Opening(s, s + w, 0.0, 2.2 if w < 2 else 4.0)
            for s, w in zip(starts, rng.choice([1.1, 3.5], doors), strict=True)
        ]
        place.fix(wall(a, b, EAVES_M, thickness=0.3, openings=openings))
        for door in openings:
            at = a + forward * (door.start_m + door.end_m) / 2 - inward * 0.12
            place.fix(box(door.end_m - door.start_m, 0.05, door.head_m), at[0], at[1], 0, yaw)
        for s in np.arange(3.0, along - 1.0, 6.0):
            at = a + forward * s + inward * 0.3
            if not any(door.start_m - 0.3 < s < door.end_m + 0.3 for door in openings):
                place.fix(box(0.35, 0.35, EAVES_M), at[0], at[1])


def _roof(place: Place, rng: np.random.Generator, length: float, width: float) -> None:
    """Trusses, purlins, a saddle roof, a few air ducts below it."""
    for x in np.arange(3.0, length - 1, 6.0):
        place.fix(block([x - 0.15, 0, EAVES_M - 0.5], [x + 0.15, width, EAVES_M - 0.1]))
    for y in np.linspace(2, width - 2, 6):
        place.fix(block([0, y - 0.1, EAVES_M - 0.05], [length, y + 0.1, EAVES_M + 0.1]))
    place.fix(gable(length + 0.6, width + 0.6, ROOF_M, underside=False), length / 2, width / 2, EAVES_M)
    for y in np.linspace(6, width - 6, 3) + rng.uniform(-1, 1, 3):
        duct = rng.uniform(10, 25)
        place.fix(lying(cylinder(0.4, duct)), rng.uniform(1, length - duct - 1), y, 6.4)


def _pillars(place: Place, at_x: NDArray[np.float64], at_y: NDArray[np.float64]) -> None:
    """On a grid of their own, through racks and shop alike, but never in the robot's way."""
    way = smoothed(place)[:, :2]
    for x in at_x:
        for y in at_y:
            if np.linalg.norm(way - [x, y], axis=1).min() > 1.2:
                place.fix(box(0.4, 0.4, EAVES_M), x, y)


def _double_row(place: Place, rng: np.random.Generator, start: float, y: float, bays: int) -> None:
    """Two racks back to back: each bay like the next but for what lies in it, a gap here and there."""
    gap = int(rng.integers(1, bays - 1)) if rng.uniform() < 0.2 else None  # a bay left out
    levels = LEVELS_M[:-1] if rng.uniform() < 0.15 else LEVELS_M
    height = levels[-1] + 1.5
    for centre in (y - RACK_DEPTH_M / 2 - 0.05, y + RACK_DEPTH_M / 2 + 0.05):
        for k in range(bays + 1):
            for dy in (-0.5, 0.5):
                place.fix(box(0.1, 0.1, height), start + k * BAY_M, centre + dy)
        for k in range(bays):
            if k != gap:
                _bay(place, rng, start + (k + 0.5) * BAY_M, centre, levels)
        for end in (start - 0.3, start + bays * BAY_M + 0.3):  # guards against forklifts
            place.fix(box(0.12, RACK_DEPTH_M, 0.4), end, centre)


def _bay(place: Place, rng: np.random.Generator, x: float, y: float, levels: tuple[float, ...]) -> None:
    for z in levels[1:]:
        place.fix(box(BAY_M - 0.1, RACK_DEPTH_M - 0.1, 0.02), x, y, z - 0.02)
        for dy in (-0.48, 0.48):
            place.fix(box(BAY_M - 0.1, 0.06, 0.12), x, y + dy, z - 0.12)
    for z in levels:
        for slot in (-0.85, 0.0, 0.85):
            if rng.uniform() < 0.15:
                continue
            goods = _load(1.0 if rng.uniform() < 0.7 else rng.uniform(0.2, 1.25))
            if z < 2:  # only things within reach come and go
                place.put(goods, x + slot, y, z, reach_m=0.1)
            else:
                place.fix(goods, x + slot, y, z)


def _load(height: float) -> Mesh:
    return Mesh.joined([box(0.8, 1.0, 0.14), box(0.74, 0.98, height, foot=0.14)])


def _production(place: Place, rng: np.random.Generator, start: float, length: float, width: float) -> None:
    """Two columns of machines with a lane between them, a foreman's office, tanks, a conveyor."""
    place.fix(_foreman_office(), length - 3.2, 2.9)
    place.fix(conveyor(5.0), start + 2.6, 4.4, 0, np.pi / 2 + rng.uniform(-0.1, 0.1))
    for y in np.arange(13.0, width - 10, 7.0):
        for x, facing in ((start + 1.6, 1), (length - 2.6, -1)):
            if rng.uniform() < 0.9:
                place.fix(machine(rng), x, y + rng.uniform(-0.7, 0.7), 0, facing * np.pi / 2)
                bench_x = x + facing * rng.uniform(2.4, 3.2)  # beside the lane
                place.put(table(1.8, 0.8), bench_x, y + rng.uniform(-2, 2), 0, np.pi / 2, reach_m=0.3)
                goods = rng.uniform(0.3, 1.4)
                place.put(pallet(rng, height=goods), bench_x - 0.4 * facing, y + 3.2, reach_m=0.4)
    for x in np.arange(length - 2.2, start + 1.5, -3.4)[: int(rng.integers(2, 5))]:
        place.fix(tank(rng.uniform(0.9, 1.3), rng.uniform(3.5, 6.0)), x, width - 1.9)


def _foreman_office() -> Mesh:
    """A 5.6 x 5 m room in the hall: windows towards the machines, an open door, a desk."""
    door = [Opening(3.6, 4.6, 0.0, 2.1), Opening(0.8, 2.8, 1.0, 2.1)]
    window = [Opening(0.8, 4.2, 1.0, 2.1)]
    walls = [
        wall((-2.8, 2.5), (2.8, 2.5), 2.7, thickness=0.1, openings=door),
        wall((-2.8, -2.5), (-2.8, 2.5), 2.7, thickness=0.1, openings=window),
        wall((2.8, -2.5), (2.8, 2.5), 2.7, thickness=0.1),
        wall((-2.8, -2.5), (2.8, -2.5), 2.7, thickness=0.1),
    ]
    inside = [
        placed(desk(), -1.2, 0.4),
        placed(chair(), -1.2, -0.5),
        placed(cabinet(2.0, 0.5, 1.9), 1.4, -2.1),
    ]
    return Mesh.joined([*walls, *inside, box(5.8, 5.2, 0.12, foot=2.7)])


def _floor_goods(
    place: Place,
    rng: np.random.Generator,
    aisle_y: NDArray[np.float64],
    racks_x: tuple[float, float],
    cross_x: float,
    shop_x: float,
) -> None:
    """Pallets against the racks of some aisles and along the west wall, forklifts: the first to move."""
    half_aisle = (aisle_y[2] - aisle_y[1] - 2 * RACK_DEPTH_M - 0.1) / 2
    for y in aisle_y[1:-1]:
        for _ in range(int(rng.integers(0, 3))):
            side, x = rng.choice([-1.0, 1.0]), rng.uniform(racks_x[0] + 1, racks_x[1] - 1)
            if abs(x - cross_x) > CROSS_LANE_M:
                place.put(pallet(rng), x, y + side * (half_aisle - 0.42), reach_m=0.15)
    for y in np.linspace(14, aisle_y[-1] - 9, 3) + rng.uniform(-2, 2, 3):
        place.put(forklift(), shop_x - 0.5, y, 0, np.pi / 2 + rng.uniform(-0.2, 0.2), reach_m=0.3)
    for y in rng.uniform(3, aisle_y[-1] - 3, 8):
        place.put(pallet(rng), 0.9, y, 0, rng.uniform(0, np.pi), present=rng.uniform() < 0.7, reach_m=0.3)


def _path(aisle_y: NDArray[np.float64], lanes_x: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """Up and down every aisle, round the machines, back, and through the cross lane."""
    west, cross, east, shop = lanes_x
    first, last = aisle_y[0], aisle_y[-1]
    corners: list[tuple[float, float]] = []
    for y in aisle_y[::-1]:  # backwards: the last aisle has to lead east
        ends = [(east, y), (west, y)]
        corners += ends if len(corners) % 4 == 0 else ends[::-1]
    corners.reverse()
    corners += [(east, last - 2.9), (shop, last - 2.9), (shop, 8.0), (east, 8.0)]
    corners += [(east, first), (cross, first), (cross, last)]
    return np.column_stack([np.array(corners), np.zeros(len(corners))])
