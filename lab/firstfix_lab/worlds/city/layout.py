"""The layout of one block of a city: houses, yards, gardens, parks, car parks, and things at the kerb."""

from __future__ import annotations

import numpy as np

from firstfix_builder.mesh.mesh import Mesh
from firstfix_cli.sample_world.place import Place
from firstfix_cli.sample_world.primitives import blob, block, box, cylinder, gable, placed
from firstfix_cli.sample_world.props import bench, car, lamp_post, tree

from ..buildings import BASEMENT_M, body, court, hall, tower

BLOCK_M = 80.0  # from the middle of a street to that of the next
STREET_HALF_M = 5.0
PAVEMENT_M = 3.0
LOT_HALF_M = BLOCK_M / 2 - STREET_HALF_M - PAVEMENT_M
USES = {"perimeter": 0.36, "quarters": 0.3, "rows": 0.16, "park": 0.1, "cars": 0.08}
CLEARANCE_M = 0.4  # between things

Rng = np.random.Generator


class BlockLayout:
    """Lays one block out about its middle."""

    def __init__(self, place: Place, rng: Rng, x: float, y: float) -> None:
        self._place, self._rng, self._x, self._y = place, rng, x, y
        self._taken: list[tuple[float, float, float, float]] = []  # low and high corners

    def lay_out(self) -> None:
        """Choose a use for the block, and stands everything."""
        use = str(self._rng.choice(list(USES), p=list(USES.values())))
        {
            "perimeter": self._perimeter,
            "quarters": self._quarters,
            "rows": self._rows,
            "park": self._park,
            "cars": self._car_park,
        }[use]()
        self._green(3 if use in ("cars", "perimeter") else 8)
        self._pavements()

    def _fix(self, shape: Mesh, x: float, y: float, yaw_rad: float = 0.0, z: float = 0.0) -> None:
        self._place.fix(shape, self._x + x, self._y + y, z, yaw_rad)

    def _take(self, low_x: float, low_y: float, high_x: float, high_y: float) -> bool:
        """Take a rectangle if it is free. Returns whether it was."""
        for a, b, c, d in self._taken:
            if low_x < c and a < high_x and low_y < d and b < high_y:
                return False
        self._taken.append((low_x, low_y, high_x, high_y))
        return True

    def _house(self, x: float, y: float, length: float, width: float, height: float, turn: int) -> None:
        """A house, by quarter turns, and its ground taken."""
        rng = self._rng
        parts = [body(rng, length, width, height)]
        if rng.uniform() < 0.6:
            parts.append(placed(gable(length + 0.6, width + 0.6, rng.uniform(2, 4.5)), 0, 0, height))
        else:
            parts.append(placed(box(3, 2.5, 2.4), rng.uniform(-0.3, 0.3) * length, 0, height))
        if rng.uniform() < 0.5:  # steps to its door
            at = rng.uniform(-0.35, 0.35) * length
            parts += [
                placed(box(1.8, 1.2, 0.4 + BASEMENT_M, foot=-BASEMENT_M), at, -width / 2 - 0.6),
                placed(box(2.2, 1.6, 0.2, foot=2.8), at, -width / 2 - 0.8),
            ]
        self._fix(Mesh.joined(parts), x, y, turn * np.pi / 2)
        a, b = (length / 2, width / 2) if turn % 2 == 0 else (width / 2, length / 2)
        self._taken.append((x - a - 1.4, y - b - 1.4, x + a + 1.4, y + b + 1.4))

    def _perimeter(self) -> None:
        """Houses wall to wall along the four streets, with gateways into a yard; sheds in it."""
        rng, half = self._rng, LOT_HALF_M
        for turn in range(4):
            depth = rng.uniform(9, 12)
            at = -half + (13.0 if turn % 2 else 0.0)
            end = half - (13.0 if turn % 2 else 0.0)
            while at < end - 7:
                length = min(rng.uniform(8, 17), end - at)
                if rng.uniform() < 0.14:
                    at += rng.uniform(3.5, 6)  # a gateway
                    continue
                x, y = at + length / 2, -half + depth / 2
                for _ in range(turn):
                    x, y = -y, x
                self._house(x, y, length, depth, rng.uniform(6, 19), turn)
                at += length
        for _ in range(int(rng.integers(2, 7))):
            x, y = rng.uniform(-half + 15, half - 15, 2)
            length, width = rng.uniform(2.5, 6, 2)
            if self._take(x - length / 2, y - width / 2, x + length / 2, y + width / 2):
                self._fix(box(length, width, rng.uniform(2, 3.5) + 1, foot=-1), x, y)

    def _quarters(self) -> None:
        """A large building of any kind in most quarters."""
        rng = self._rng
        for x in (-16.0, 16.0):
            for y in (-16.0, 16.0):
                if rng.uniform() < 0.15:
                    continue
                shape, _ = [hall, court, tower][int(rng.integers(3))](rng)
                turn = int(rng.integers(4)) * np.pi / 2
                self._fix(shape, x + rng.uniform(-1, 1), y + rng.uniform(-1, 1), turn)
                self._taken.append((x - 15, y - 15, x + 15, y + 15))

    def _rows(self) -> None:
        """Rows of small houses with gardens, hedges and walls between them."""
        rng = self._rng
        for row, turn in ((-21.0, 0), (21.0, 2)):
            at = -LOT_HALF_M + rng.uniform(0, 3)
            while at < LOT_HALF_M - 9:
                length = rng.uniform(7, 11)
                self._house(at + length / 2, row, length, rng.uniform(8, 10), rng.uniform(4.5, 8), turn)
                at += length + rng.uniform(2, 5)
                if rng.uniform() < 0.7:
                    side = -1 if row < 0 else 1
                    hedge = rng.uniform() < 0.5
                    self._fix(
                        box(0.9 if hedge else 0.25, 14, rng.uniform(1.2, 2.2) + 0.5, foot=-0.5),
                        at - 1.2,
                        row - side * 13,
                    )
        for _ in range(int(rng.integers(4, 10))):
            x, y = rng.uniform(-LOT_HALF_M + 2, LOT_HALF_M - 2), rng.uniform(-12, 12)
            if self._take(x - 1.8, y - 1.5, x + 1.8, y + 1.5):
                self._fix(box(3.0, 2.4, 2.3 + 0.6, foot=-0.6), x, y, rng.uniform(-0.2, 0.2))

    def _park(self) -> None:
        """Trees and benches, and a pavilion or a monument."""
        rng = self._rng
        x, y = rng.uniform(-8, 8, 2)
        if self._take(x - 5, y - 5, x + 5, y + 5):
            if rng.uniform() < 0.5:
                posts = [
                    placed(cylinder(0.2, 3.5, foot=-0.5, sides=8), a, b) for a in (-3, 3) for b in (-3, 3)
                ]
                self._fix(Mesh.joined([*posts, box(7.2, 7.2, 0.3, foot=3.0)]), x, y, rng.uniform(0, 1.5))
            else:
                steps = [box(6 - 1.5 * k, 6 - 1.5 * k, 0.5 * (k + 1) + 1, foot=-1) for k in range(3)]
                self._fix(Mesh.joined([*steps, cylinder(0.7, 7, top_radius=0.3)]), x, y, rng.uniform(0, 1.5))
        self._green(22)

    def _car_park(self) -> None:
        """Rows of bays, most of them taken, and a hall."""
        rng = self._rng
        turn = int(rng.integers(4))
        shape, _ = hall(rng)
        aside, back = rng.uniform(-12, 12), rng.uniform(14, 19)
        self._fix(shape, *_turned(aside, back, turn), turn * np.pi / 2)
        corners = np.array([_turned(aside - 15, 4, turn), _turned(aside + 15, 30, turn)])
        self._taken.append((*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()))
        first, pitch = rng.uniform(-30, -27), rng.uniform(2.5, 2.9)
        for row in first + np.array([0.0, rng.uniform(10, 12), rng.uniform(16, 18)]):
            for bay in np.arange(-28.0, 28.1, pitch):
                x, y = _turned(bay, row, turn)
                if self._take(x - 1.2, y - 1.2, x + 1.2, y + 1.2):
                    heading = (turn + rng.choice([-1, 1])) * np.pi / 2 + rng.uniform(-0.05, 0.05)
                    spot = (self._x + x, self._y + y)
                    self._place.put(car(rng), *spot, 0, heading, present=rng.uniform() < 0.6)

    def _green(self, trees: int) -> None:
        """Trees, bushes and benches where the lot has room."""
        rng, half = self._rng, LOT_HALF_M
        for x, y in rng.uniform(-half + 1, half - 1, (trees, 2)):
            if self._take(x - 1.2, y - 1.2, x + 1.2, y + 1.2):
                self._fix(tree(rng), x, y, rng.uniform(0, 2 * np.pi))
        for x, y in rng.uniform(-half + 1, half - 1, (trees, 2)):
            size = rng.uniform(0.5, 1.2)
            reach = size + CLEARANCE_M
            if self._take(x - reach, y - reach, x + reach, y + reach):
                self._fix(blob(size, rng.uniform(0.7, 1.8), rng), x, y, z=-0.15)
        for x, y in rng.uniform(-half + 1, half - 1, (trees // 4, 2)):
            if self._take(x - 1, y - 1, x + 1, y + 1):
                self._place.put(bench(), self._x + x, self._y + y, 0, rng.uniform(0, 2 * np.pi))

    def _pavements(self) -> None:
        """Stands lamps, trees, parked cars and now and then a bus stop along the half streets."""
        rng = self._rng
        for turn in range(4):
            yaw = turn * np.pi / 2
            character = rng.choice(["avenue", "cars", "bare"], p=[0.25, 0.5, 0.25])
            kerb = -LOT_HALF_M - PAVEMENT_M
            for along in np.arange(-28.0, 28.1, 14.0):
                self._at_kerb(lamp_post(), along, kerb + 0.5, turn, yaw - np.pi / 2)
            if character == "avenue":
                for along in np.arange(-24.0, 24.1, rng.uniform(8, 13)):
                    self._at_kerb(tree(rng), along, kerb + 0.9, turn, rng.uniform(0, 2 * np.pi))
            elif character == "cars":
                for along in np.arange(-27.0, 27.1, 5.8):
                    heading = yaw + rng.choice([0.0, np.pi]) + rng.uniform(-0.03, 0.03)
                    x, y = _turned(along + rng.uniform(-0.4, 0.4), kerb - 1.1, turn)
                    self._place.put(
                        car(rng),
                        self._x + x,
                        self._y + y,
                        0,
                        heading,
                        present=rng.uniform() < 0.65,
                        reach_m=0.3,
                    )
            if rng.uniform() < 0.25:
                shelter = Mesh.joined(
                    [
                        block([-2, 0.9, -0.4], [2, 1.0, 2.3]),
                        block([-2, -0.3, 2.3], [2, 1.1, 2.45]),
                        block([-2, -0.2, -0.4], [-1.9, 1.0, 2.3]),
                    ]
                )
                self._at_kerb(shelter, rng.uniform(-20, 20), kerb + 1.4, turn, yaw)

    def _at_kerb(self, shape: Mesh, along: float, aside: float, turn: int, yaw_rad: float) -> None:
        self._fix(shape, *_turned(along, aside, turn), yaw_rad)


def _turned(x: float, y: float, quarters: int) -> tuple[float, float]:
    for _ in range(quarters):
        x, y = -y, x
    return x, y
