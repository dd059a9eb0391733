"""A campus on a hillside: buildings with annexes, avenues of trees, car parks, walls and fences."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.sensor import preset
from firstfix_builder.mesh.mesh import Mesh
from firstfix_cli.sample_world.place import Ground, Place
from firstfix_cli.sample_world.primitives import blob, box, height_field, placed
from firstfix_cli.sample_world.props import bench, car, lamp_post, tree

from .buildings import court, hall, tower

HALF_M = 80.0
TERRAIN_STEP_M = 1.0
STREETS_M = (-69.0, -23.0, 23.0, 69.0)  # their lines before they are bent
LOTS_M = (-46.0, 0.0, 46.0)
LOT_HALF_M = 17.0
VERGE_M = 2.2  # from the middle of a street to what stands beside it
# A tour of the street corners (column, row) that drives nearly every street once.
TOUR = (
    *((0, 0), (1, 0), (1, 1), (1, 2), (1, 3), (2, 3), (2, 2), (2, 1), (2, 0), (3, 0)),
    *((3, 1), (2, 1), (1, 1), (0, 1), (0, 2), (1, 2), (2, 2), (3, 2), (3, 3), (2, 3)),
)


def campus(rng: np.random.Generator) -> Place:
    """160 x 160 m: a bent grid of streets, in each of its nine lots buildings, a park or a car park."""
    ground = _relief(rng)
    place = Place(preset("os1-64"), _streets(rng), voxel_m=0.2, stride_m=1.0, corner_m=1.5, ground=ground)
    place.fixed.append(terrain(ground))

    space = FreeSpace(place.path)
    uses = rng.permutation(["hall", "hall", "court", "court", "tower", "tower", "hall", "park", "cars"])
    for use, (x, y) in zip(uses, [(x, y) for x in LOTS_M for y in LOTS_M], strict=True):
        if use == "cars":
            _car_park(place, space, rng, x, y)
        elif use != "park":
            _building(place, space, rng, str(use), x, y)
        _greenery(place, space, rng, x, y, trees=30 if use == "park" else 7)
    _border(place, space, rng)
    _along_the_streets(place, space, rng)
    return place


class FreeSpace:
    """Keeps things off the streets and out of each other: circles on the ground."""

    def __init__(self, path: NDArray[np.float64]) -> None:
        steps = np.arange(0, 1, 0.01)[:, None, None]
        line = path[:-1, :2] + steps * np.diff(path[:, :2], axis=0)
        self._streets = cKDTree(line.reshape(-1, 2))
        self._taken: list[tuple[float, float, float]] = []

    def take(self, x: float, y: float, radius: float) -> bool:
        """Take a circle if it is free. Returns whether it was."""
        if max(abs(x), abs(y)) + radius > HALF_M or self._streets.query([x, y])[0] < radius + VERGE_M:
            return False
        if any((x - a) ** 2 + (y - b) ** 2 < (radius + r) ** 2 for a, b, r in self._taken):
            return False
        self._taken.append((x, y, radius))
        return True

    def occupy(self, x: float, y: float, radius: float) -> None:
        """Take a circle, free or not."""
        self._taken.append((x, y, radius))


def terrain(ground: Ground) -> Mesh:
    """The ground of a square world of 2 * HALF_M."""
    axis = np.arange(-HALF_M, HALF_M + TERRAIN_STEP_M / 2, TERRAIN_STEP_M)
    gx, gy = np.meshgrid(axis, axis)
    return height_field(axis, axis, ground(gx.ravel(), gy.ravel()).reshape(gx.shape))


def _relief(rng: np.random.Generator) -> Ground:
    """A slope across the whole campus and some hills and hollows on it."""
    slope = rng.uniform(-0.03, 0.03, 2)
    middle = rng.uniform(-HALF_M, HALF_M, (9, 2))
    height, spread = rng.uniform(-2.6, 2.6, 9), rng.uniform(16, 34, 9)

    def ground(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        squared = (x[:, None] - middle[:, 0]) ** 2 + (y[:, None] - middle[:, 1]) ** 2
        z: NDArray[np.float64] = slope[0] * x + slope[1] * y + np.exp(-squared / (2 * spread**2)) @ height
        return z

    return ground


def _streets(rng: np.random.Generator) -> NDArray[np.float64]:
    """The tour over corners that lie a little off the grid, each street with a bend of its own."""
    x, y = np.meshgrid(STREETS_M, STREETS_M, indexing="ij")
    corners = np.stack([x, y], axis=-1) + rng.uniform(-2.0, 2.0, (4, 4, 2))
    bends = rng.uniform(-2.5, 2.5, (4, 4, 2, 2))  # of the street from a corner along x and along y
    way = [corners[TOUR[0]]]
    for a, b in pairwise(TOUR):
        low = min(a, b)
        bend = bends[low][0 if a[0] != b[0] else 1]
        way += [(corners[a] + corners[b]) / 2 + bend, corners[b]]
    return np.column_stack([np.array(way), np.zeros(len(way))])


def _building(place: Place, space: FreeSpace, rng: np.random.Generator, use: str, x: float, y: float) -> None:
    shape, reach = {"hall": hall, "court": court, "tower": tower}[use](rng)
    turn = float(rng.choice([0.0, 0.5, 1.0, 1.5]) * np.pi + rng.uniform(-0.08, 0.08))
    x, y = x + rng.uniform(-2, 2), y + rng.uniform(-2, 2)
    place.fix(shape, x, y, 0.0, turn)
    for dx, dy in reach:
        c, s = np.cos(turn), np.sin(turn)
        space.occupy(x + c * dx - s * dy, y + s * dx + c * dy, 5.0)


def _car_park(place: Place, space: FreeSpace, rng: np.random.Generator, x: float, y: float) -> None:
    """Four rows of bays, most of them taken, with lamps between."""
    for row, facing in zip((-13.0, -1.9, 3.1, 14.0), (1, -1, 1, -1), strict=True):
        for bay in np.arange(-14.0, 14.1, 2.6):
            spot = (x + bay, y + row)
            place.put(
                car(rng), *spot, 0, facing * np.pi / 2 + rng.uniform(-0.05, 0.05), present=rng.uniform() < 0.6
            )
            space.occupy(*spot, 2.0)
    for bay in (-9.0, 9.0):
        place.fix(lamp_post(), x + bay, y + 0.6)


def _greenery(
    place: Place, space: FreeSpace, rng: np.random.Generator, x: float, y: float, *, trees: int
) -> None:
    """Trees, bushes, a few benches and hedges wherever the lot has room."""
    for dx, dy in rng.uniform(-LOT_HALF_M, LOT_HALF_M, (trees, 2)):
        if space.take(x + dx, y + dy, 1.5):
            place.fix(tree(rng), x + dx, y + dy, 0, rng.uniform(0, 2 * np.pi))
    for dx, dy in rng.uniform(-LOT_HALF_M, LOT_HALF_M, (trees, 2)):
        size = rng.uniform(0.5, 1.2)
        if space.take(x + dx, y + dy, size):
            place.fix(blob(size, rng.uniform(0.7, 1.8), rng), x + dx, y + dy, -0.15)
    for dx, dy in rng.uniform(-LOT_HALF_M, LOT_HALF_M, (trees // 3, 2)):
        if space.take(x + dx, y + dy, 1.0):
            place.put(bench(), x + dx, y + dy, 0, rng.uniform(0, 2 * np.pi))


def _border(place: Place, space: FreeSpace, rng: np.random.Generator) -> None:
    """On each side of the campus a wall, a fence or a hedge, with gaps; woods where it is open."""
    for side in range(4):
        kind = rng.choice(["wall", "fence", "hedge"])
        for along in np.arange(-74.0, 74.0, 4.0):
            x, y = _turned(along, -HALF_M + 2.0, side)
            if rng.uniform() < 0.15:
                if space.take(x, y, 1.5):
                    place.fix(tree(rng), x, y, 0, along)
                continue
            panel = {
                "wall": Mesh.joined(
                    [box(4.0, 0.3, 2.6, foot=-0.6), placed(box(0.5, 0.5, 2.9, foot=-0.6), 2.0, 0)]
                ),
                "fence": Mesh.joined(
                    [placed(box(0.1, 0.1, 1.8, foot=-0.4), dx, 0) for dx in (0.0, 2.0)]
                    + [box(4.0, 0.05, 0.12, foot=z) for z in (0.2, 0.6, 1.0, 1.3)]
                ),
                "hedge": box(4.0, 0.9, 1.9, foot=-0.4),
            }[str(kind)]
            place.fix(panel, x, y, 0, side * np.pi / 2)


def _turned(x: float, y: float, quarters: int) -> tuple[float, float]:
    for _ in range(quarters):
        x, y = -y, x
    return x, y


def _along_the_streets(place: Place, space: FreeSpace, rng: np.random.Generator) -> None:
    """Each street gets its own character: an avenue of trees, parked cars or nothing, and lamps."""
    for start, end in zip(place.path[:-1, :2], place.path[1:, :2], strict=True):
        character = rng.choice(["avenue", "cars", "bare"], p=[0.35, 0.4, 0.25])
        side = float(rng.choice([-1.0, 1.0]))
        for spot, yaw in _beside(start, end, spacing_m=11.0, aside_m=-side * 3.2):
            if space.take(*spot, 0.3):
                place.fix(lamp_post(), *spot, 0, yaw + (np.pi / 2 if side > 0 else -np.pi / 2))
        if character == "avenue":
            for spot, _ in _beside(start, end, spacing_m=rng.uniform(5, 8), aside_m=side * 4.2):
                if space.take(*spot, 1.0):
                    place.fix(tree(rng), *spot, 0, rng.uniform(0, 2 * np.pi))
        elif character == "cars":
            for spot, yaw in _beside(start, end, spacing_m=5.6, aside_m=side * 3.6):
                if space.take(*spot, 1.3):
                    turn = yaw + rng.choice([0.0, np.pi]) + rng.uniform(-0.03, 0.03)
                    place.put(car(rng), *spot, 0, turn, present=rng.uniform() < 0.7, reach_m=0.3)


def _beside(
    start: NDArray[np.float64], end: NDArray[np.float64], *, spacing_m: float, aside_m: float
) -> Iterator[tuple[tuple[float, float], float]]:
    """Spots (x, y) beside a stretch of street, and its heading; none close to its corners."""
    length = float(np.hypot(*(end - start)))
    forward = (end - start) / length
    left = np.array([-forward[1], forward[0]])
    for along in np.arange(4.0, length - 4.0, spacing_m):
        x, y = start + forward * along + left * aside_m
        yield (float(x), float(y)), float(np.arctan2(forward[1], forward[0]))
