"""The rooms of the office: what stands in them and how a robot looks into them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firstfix_cli.sample_world.place import Place
from firstfix_cli.sample_world.props import bookcase, cabinet, chair, desk, pallet, plant, table

DEPTH_M = 8.4
AISLE_M = 0.85  # half the width that is kept free from the door on
LOOP_M = 0.42  # half the width of a robot's turn in it


@dataclass(frozen=True)
class Room:
    """A room on one side of the corridor.

    Attributes:
        left, right: its side walls, in x.
        corridor_y: the wall with its door.
        side: "south" or "north" of the corridor.
        door_x: the middle of its door.
        floor_m: height of its floor.
        use: "desks", "open", "meeting" or "store".
    """

    left: float
    right: float
    corridor_y: float
    side: str
    door_x: float
    floor_m: float
    use: str

    @property
    def into(self) -> int:
        """Sign of y from the door into the room."""
        return -1 if self.side == "south" else 1

    def y(self, depth_m: float) -> float:
        """Y at a depth behind the door wall."""
        return self.corridor_y + self.into * depth_m

    @property
    def free_depth_m(self) -> float:
        """The length of the aisle from the door to the first furniture."""
        return {"meeting": 3.4, "store": 5.0}.get(self.use, 6.4)


def tour(room: Room, corridor_y: float) -> list[tuple[float, float, float]]:
    """A narrow loop through the door, down the aisle and out again."""
    far, z, x = room.free_depth_m, room.floor_m, room.door_x
    return [
        (x, corridor_y, z),
        (x, room.y(1.2), z),
        (x - LOOP_M, room.y(2.0), z),
        (x - LOOP_M, room.y(far), z),
        (x + LOOP_M, room.y(far), z),
        (x + LOOP_M, room.y(2.0), z),
        (x, room.y(1.2), z),
        (x, corridor_y, z),
    ]


def furnish(place: Place, room: Room, rng: np.random.Generator) -> None:
    """Furniture by the room's use, with the aisle behind the door left free."""
    {"desks": _desks, "open": _desks, "meeting": _meeting, "store": _store}[room.use](place, room, rng)
    if rng.uniform() < 0.5:
        x = room.left + 0.5 if rng.uniform() < 0.5 else room.right - 0.5
        place.put(plant(rng), x, room.y(DEPTH_M - 0.6), room.floor_m, reach_m=0.2)


def _desks(place: Place, room: Room, rng: np.random.Generator) -> None:
    """Desks with their chairs along both side walls, or in islands where the room is wide enough."""
    z = room.floor_m
    for wall_x, away in ((room.left, 1), (room.right, -1)):
        free = abs(room.door_x - wall_x) - AISLE_M
        for depth in np.arange(2.4, DEPTH_M - 1.2, 2.1):
            if free < 0.95 or rng.uniform() < 0.15:
                continue
            y = room.y(depth + rng.uniform(-0.15, 0.15))
            if free > 2.2:  # an island: two desks face to face
                for shift, turn in ((-0.42, np.pi), (0.42, 0.0)):
                    x = wall_x + away * (free - 0.9 - 0.1)
                    place.fix(desk(), x, y + shift, z, turn + np.pi)
                    place.put(
                        chair(), x, y + 2.0 * shift, z, turn + np.pi + rng.uniform(-0.5, 0.5), reach_m=0.25
                    )
            else:  # facing the wall; one sits on the aisle side
                turn = np.pi / 2 if away > 0 else -np.pi / 2
                place.fix(desk(), wall_x + away * 0.52, y, z, turn)
                if free > 1.25:
                    x = wall_x + away * 0.95
                    place.put(chair(), x, y, z, turn + rng.uniform(-0.6, 0.6), reach_m=0.15)
    if rng.uniform() < 0.7:
        side = room.left + 0.25 if rng.uniform() < 0.5 else room.right - 0.25
        turn = np.pi / 2 if side < room.door_x else -np.pi / 2
        tall = rng.choice([1.2, 2.0])
        place.fix(bookcase(1.6, tall, rng), side, room.y(1.1), z, turn)


def _meeting(place: Place, room: Room, rng: np.random.Generator) -> None:
    """A long table with chairs all round, a sideboard at one wall."""
    z, x = room.floor_m, (room.left + room.right) / 2
    long = float(rng.uniform(2.6, 3.4))
    y = room.y(4.6 + long / 2)
    place.fix(table(1.3, long), x, y, z)
    for along in np.arange(-long / 2 + 0.4, long / 2, 0.75):
        for away, turn in ((-0.95, -np.pi / 2), (0.95, np.pi / 2)):
            if rng.uniform() < 0.85:
                place.put(chair(), x + away, y + along, z, turn + rng.uniform(-0.4, 0.4), reach_m=0.3)
    side = room.left + 0.32 if rng.uniform() < 0.5 else room.right - 0.32
    place.fix(cabinet(1.8, 0.5, 0.8), side, y, z, np.pi / 2)


def _store(place: Place, room: Room, rng: np.random.Generator) -> None:
    """Bookcases along the walls and across the far end, boxes on the floor."""
    z = room.floor_m
    for wall_x, turn in ((room.left + 0.25, np.pi / 2), (room.right - 0.25, -np.pi / 2)):
        for depth in np.arange(1.6, DEPTH_M - 0.8, 1.5):
            if rng.uniform() < 0.8:
                place.fix(bookcase(1.4, 2.1, rng), wall_x, room.y(depth), z, turn)
    for x in np.arange(room.left + 1.6, room.right - 1.5, 1.3):
        place.put(pallet(rng, height=rng.uniform(0.4, 1.3)), x, room.y(DEPTH_M - 1.0), z, reach_m=0.3)
        if rng.uniform() < 0.5:
            place.put(pallet(rng, height=rng.uniform(0.4, 1.0)), x, room.y(DEPTH_M - 2.2), z, reach_m=0.3)
