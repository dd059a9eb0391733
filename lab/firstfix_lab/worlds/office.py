"""An office building: two storeys alike but not equal, rooms off a corridor, a stair between them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import preset
from firstfix_builder.mesh.mesh import Mesh
from firstfix_cli.sample_world.place import Place
from firstfix_cli.sample_world.primitives import Opening, block, box, wall
from firstfix_cli.sample_world.props import bench, cabinet, plant

from .office_rooms import Room, furnish, tour

WIDTH_M, STOREY_M, SLAB_M = 20.0, 3.4, 0.3
CLEAR_M = STOREY_M - SLAB_M
CORRIDOR = (8.8, 11.4)  # its walls, in y
STAIR_X, STAIR_Y = 6.2, 14.4  # the stairwell is the corner 0..STAIR_X by CORRIDOR[1]..STAIR_Y
STEPS, TREAD_M, LANDING_M = 10, 0.28, 1.6  # of each of the two flights
DOOR_M, DOOR_HEAD_M = 1.05, 2.1
LANE_M = 0.2  # the robot keeps this far to the right of the corridor's middle
ROOM_WIDTHS_M = (3.8, 4.6, 5.4, 6.6, 8.0)


@dataclass(frozen=True)
class Storey:
    """The rooms of one floor."""

    floor_m: float
    rooms: list[Room]


def office(rng: np.random.Generator) -> Place:
    """About 40 x 20 m. The robot tours the ground floor, climbs the stair and tours the upper floor."""
    length = 40 + rng.uniform(-2, 2)
    place = Place(preset("os0-64"), np.empty((0, 3)), voxel_m=0.1, stride_m=0.4, corner_m=0.25)
    plan = {
        "south": _splits(rng, 0.0, length),
        "north": _splits(rng, STAIR_X, length),
    }
    storeys = [
        _storey(rng, 0.0, plan, alter=False),
        _storey(rng, STOREY_M, plan, alter=True),
    ]
    for storey in storeys:
        _walls(place, storey, length)
        for room in storey.rooms:
            furnish(place, room, rng)
        _corridor_things(place, storey, length, rng)
    _slabs(place, length)
    _stair(place)
    place.path = _path(storeys, length)
    return place


def _splits(rng: np.random.Generator, start: float, end: float) -> NDArray[np.float64]:
    """Room boundaries from start to end: widths drawn from those that offices have."""
    at = [start]
    while end - at[-1] > 2 * max(ROOM_WIDTHS_M):
        at.append(at[-1] + float(rng.choice(ROOM_WIDTHS_M)))
    rest = end - at[-1]
    pieces = max(2, round(rest / 5.0))
    return np.array([*at, *(at[-1] + rest * np.arange(1, pieces + 1) / pieces)])


def _storey(
    rng: np.random.Generator, floor_m: float, plan: dict[str, NDArray[np.float64]], *, alter: bool
) -> Storey:
    """Rooms of one storey. An altered one has some walls moved and, on each side, two rooms made one."""
    rooms = []
    for side, splits in plan.items():
        if alter:
            inner = splits[1:-1] + rng.choice([0.0, 0.0, -0.6, 0.5], len(splits) - 2)
            splits = np.concatenate([splits[:1], np.delete(inner, rng.integers(len(inner))), splits[-1:]])
        for left, right in pairwise(splits):
            use = "open" if right - left > 7 else str(rng.choice(["desks", "desks", "meeting", "store"]))
            door = (left + right) / 2 + rng.uniform(-0.2, 0.2)
            rooms.append(Room(left, right, CORRIDOR[0 if side == "south" else 1], side, door, floor_m, use))
    return Storey(floor_m, rooms)


def _walls(place: Place, storey: Storey, length: float) -> None:
    """Partitions, corridor walls with doors standing open, a facade with windows."""
    z = storey.floor_m

    def add(a: tuple[float, float], b: tuple[float, float], thick: float, openings: list[Opening]) -> None:
        place.fix(wall(a, b, CLEAR_M, foot=z, thickness=thick, openings=openings))

    for side, corridor_y, facade_y in (("south", CORRIDOR[0], 0.0), ("north", CORRIDOR[1], WIDTH_M)):
        rooms = [room for room in storey.rooms if room.side == side]
        doors = [_door(room.door_x) for room in rooms]
        windows = [opening for room in rooms for opening in _windows(room)]
        if side == "north":
            doors.append(_door(_stair_door_x()))
        add((0, corridor_y), (length, corridor_y), 0.12, doors)
        add((0, facade_y), (length, facade_y), 0.3, windows)
        for room in rooms[1:]:
            add((room.left, corridor_y), (room.left, facade_y), 0.12, [])
        for room in rooms:  # a leaf at right angles to the wall, beside the opening
            into = -1 if side == "south" else 1
            leaf = block([-0.02, 0, 0.02], [0.02, into * 0.95, DOOR_HEAD_M])
            place.fix(leaf, room.door_x - DOOR_M / 2 - 0.04, corridor_y + into * 0.08, z)
    add((STAIR_X, CORRIDOR[1]), (STAIR_X, WIDTH_M), 0.2, [])
    add((0, STAIR_Y), (STAIR_X, STAIR_Y), 0.2, [])
    # the gables: a window at the end of the corridor, another in the stairwell
    add((length, 0), (length, WIDTH_M), 0.3, [Opening(9.6, 10.6, 0.4, 2.4)])
    add((0, 0), (0, WIDTH_M), 0.3, [Opening(9.5, 10.7, 0.9, 2.3), Opening(12.2, 13.4, 1.4, 2.6)])


def _door(x: float) -> Opening:
    return Opening(x - DOOR_M / 2, x + DOOR_M / 2, 0.0, DOOR_HEAD_M)


def _windows(room: Room) -> list[Opening]:
    count = max(1, int((room.right - room.left) / 2.6))
    middles = room.left + (np.arange(count) + 0.5) * (room.right - room.left) / count
    return [Opening(float(m) - 0.8, float(m) + 0.8, 0.9, 2.4) for m in middles]


def _stair_door_x() -> float:
    return STAIR_X - LANDING_M / 2 - 0.1


def _corridor_things(place: Place, storey: Storey, length: float, rng: np.random.Generator) -> None:
    """Cabinets, benches and plants along the walls, where no door is."""
    for side, y in (("south", CORRIDOR[0]), ("north", CORRIDOR[1])):
        doors = [room.door_x for room in storey.rooms if room.side == side] + [_stair_door_x()]
        inward = 1 if side == "south" else -1
        for x in np.arange(3.6, length - 3.6, 3.0) + rng.uniform(-0.8, 0.8):
            if min(abs(x - d) for d in doors) < 1.5 or rng.uniform() < 0.35:
                continue
            kind = rng.choice(["cabinet", "bench", "plant"], p=[0.5, 0.2, 0.3])
            if kind == "cabinet":
                place.fix(cabinet(1.0, 0.36, rng.choice([1.1, 1.9])), x, y + inward * 0.26, storey.floor_m)
            elif kind == "bench":
                turn = np.pi if side == "south" else 0.0
                place.put(bench(), x, y + inward * 0.36, storey.floor_m, turn, reach_m=0.1)
            else:
                place.put(plant(rng), x, y + inward * 0.38, storey.floor_m, reach_m=0.05)


def _slabs(place: Place, length: float) -> None:
    """Ground floor, the floor between with the stair's hole in it, the roof."""
    place.fix(block([-0.15, -0.15, -SLAB_M], [length + 0.15, WIDTH_M + 0.15, 0.0]))
    hole_x, low, high = STAIR_X - LANDING_M, STOREY_M - SLAB_M, STOREY_M
    place.fix(block([hole_x, -0.15, low], [length + 0.15, WIDTH_M + 0.15, high]))
    place.fix(block([-0.15, -0.15, low], [hole_x, CORRIDOR[1], high]))
    place.fix(block([-0.15, STAIR_Y, low], [hole_x, WIDTH_M + 0.15, high]))
    place.fix(block([-0.15, CORRIDOR[1], low], [0.15, STAIR_Y, high]))  # the facade, past the hole
    top = 2 * STOREY_M
    place.fix(block([-0.15, -0.15, top - SLAB_M], [length + 0.15, WIDTH_M + 0.15, top]))


def _stair(place: Place) -> None:
    """Two flights with a landing half way up, a parapet between them and a rail round the hole."""
    south, middle, north = CORRIDOR[1] + 0.06, (CORRIDOR[1] + STAIR_Y) / 2, STAIR_Y - 0.1
    rise, foot_x = STOREY_M / 2 / STEPS, STAIR_X - LANDING_M
    parts: list[Mesh] = []
    for k in range(STEPS):
        x1, x0 = foot_x - k * TREAD_M, foot_x - (k + 1) * TREAD_M
        z = (k + 1) * rise
        parts.append(block([x0, south, max(0.0, z - 0.35)], [x1, middle - 0.06, z]))
        parts.append(block([x0, middle - 0.06, max(0.0, z - 0.35)], [x1, middle + 0.06, z + 0.7]))
        x0, x1 = foot_x - (STEPS - k) * TREAD_M, foot_x - (STEPS - k - 1) * TREAD_M
        z += STOREY_M / 2
        parts.append(block([x0, middle + 0.06, z - 0.35], [x1, north, z]))
    half = STOREY_M / 2
    parts.append(block([0.15, south, half - 0.2], [foot_x - STEPS * TREAD_M, north, half]))
    parts.append(block([foot_x - 0.06, south, STOREY_M], [foot_x, middle - 0.06, STOREY_M + 0.95]))
    place.fix(Mesh.joined(parts))
    place.fix(box(0.5, 0.3, 0.9), 0.6, CORRIDOR[0] + 0.5)  # a reception pulpit by the stairwell


def _path(storeys: list[Storey], length: float) -> NDArray[np.float64]:
    """Along the corridor of each storey and into its rooms, with the stair in between."""
    middle_y = sum(CORRIDOR) / 2
    door_x, foot_x = _stair_door_x(), STAIR_X - LANDING_M
    landing_x = (foot_x - STEPS * TREAD_M + 0.15) / 2
    flight = (STAIR_Y - CORRIDOR[1]) / 4
    up_y, on_y = CORRIDOR[1] + flight, CORRIDOR[1] + 3 * flight - 0.05
    half, top = STOREY_M / 2, STOREY_M

    def storey_tour(storey: Storey) -> list[tuple[float, float, float]]:
        z = storey.floor_m
        east = [room for k, room in enumerate(_by_door(storey, "south")) if k % 3 != 1]
        west = [room for k, room in enumerate(_by_door(storey, "north")) if k % 3 != 2][::-1]
        corners = [(door_x, middle_y + LANE_M, z), (2.4, middle_y + LANE_M, z)]
        corners += [(x, middle_y + y, z) for x, y in ((1.7, 0.4), (1.2, 0.4), (1.2, -0.4))]
        for room in east:
            corners += tour(room, middle_y - LANE_M)
        ease = [(1.5, -LANE_M), (0.9, -0.4), (0.9, 0.4), (1.5, LANE_M)]  # wider only at the very end
        corners += [(length - x, middle_y + y, z) for x, y in ease]
        for room in west:
            corners += tour(room, middle_y + LANE_M)
        return [*corners, (door_x, middle_y, z)]

    stair = [
        (door_x, up_y, 0.0),
        (foot_x, up_y, 0.0),
        (foot_x - STEPS * TREAD_M, up_y, half),
        (landing_x, up_y, half),
        (landing_x, on_y, half),
        (foot_x - STEPS * TREAD_M, on_y, half),
        (foot_x, on_y, top),
        (door_x, on_y, top),
    ]
    return np.array([*storey_tour(storeys[0]), *stair, *storey_tour(storeys[1])])


def _by_door(storey: Storey, side: str) -> list[Room]:
    return sorted((room for room in storey.rooms if room.side == side), key=lambda room: room.door_x)
