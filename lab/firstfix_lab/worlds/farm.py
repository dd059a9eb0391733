"""A farm in hilly country: fields between hedges and fences, an orchard, woods, few walls."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import preset
from firstfix_builder.mesh.mesh import Mesh
from firstfix_cli.sample_world.place import Ground, Place
from firstfix_cli.sample_world.primitives import blob, box, cylinder, gable, lying, placed
from firstfix_cli.sample_world.props import tank, tree

from .campus import HALF_M, FreeSpace, terrain

TRACKS_M = (-58.0, 0.0, 58.0)  # lines of the farm tracks before they are bent
FIELDS_M = (-29.0, 29.0)
FIELD_HALF_M = 24.0
# A tour of the corners (column, row) that drives every track, without turning on the spot.
TOUR = (
    *((0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1), (0, 0)),
    *((1, 0), (1, 1), (1, 2), (0, 2), (0, 1), (1, 1), (2, 1)),
)
FOUNDATION_M = 4.0  # walls reach this far down, so that no gap opens on the low side of a slope

Rng = np.random.Generator


def farm(rng: Rng) -> Place:
    """160 x 160 m: four fields, one of them with the farmyard, one an orchard, woods around."""
    ground = _relief(rng)
    place = Place(preset("vlp-16"), _tracks(rng), voxel_m=0.2, stride_m=1.0, corner_m=2.0, ground=ground)
    place.fixed.append(terrain(ground))

    space = FreeSpace(place.path)
    uses = rng.permutation(["yard", "orchard", "meadow", "stubble"])
    for use, (x, y) in zip(uses, [(x, y) for x in FIELDS_M for y in FIELDS_M], strict=True):
        if use == "yard":
            _yard(place, space, rng, x, y)
        elif use == "orchard":
            _orchard(place, space, rng, x, y)
        elif use == "stubble":
            _bales(place, space, rng, x, y)
        _bounds(place, space, rng, x, y)
        _bushes(place, space, rng, x, y, count=5)
    _woods(place, space, rng)
    return place


def _relief(rng: Rng) -> Ground:
    """A slope across the whole farm, hills and hollows on it, and clods: nowhere is a level surface."""
    slope = rng.uniform(-0.06, 0.06, 2)
    middle = rng.uniform(-HALF_M, HALF_M, (14, 2))
    height, spread = rng.uniform(-4.5, 4.5, 14), rng.uniform(12, 24, 14)
    wave = (
        2 * np.pi / rng.uniform(3.5, 9.0, (6, 1)) * _unit(rng.uniform(0, 2 * np.pi, 6))
    )  # (6, 2) radians a metre
    phase, clod_m = rng.uniform(0, 2 * np.pi, 6), 0.05

    def ground(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        squared = (x[:, None] - middle[:, 0]) ** 2 + (y[:, None] - middle[:, 1]) ** 2
        z: NDArray[np.float64] = slope[0] * x + slope[1] * y + np.exp(-squared / (2 * spread**2)) @ height
        return z + clod_m * np.sin(np.column_stack([x, y]) @ wave.T + phase).sum(axis=1)

    return ground


def _unit(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])


def _tracks(rng: Rng) -> NDArray[np.float64]:
    """The tour over corners that lie off the grid."""
    x, y = np.meshgrid(TRACKS_M, TRACKS_M, indexing="ij")
    corners = np.stack([x, y], axis=-1) + rng.uniform(-6.0, 6.0, (3, 3, 2))
    bends = rng.uniform(-4.0, 4.0, (3, 3, 2, 2))  # of the track from a corner along x and along y
    way = [corners[TOUR[0]]]
    for a, b in pairwise(TOUR):
        bend = bends[min(a, b)][0 if a[0] != b[0] else 1]
        way += [(corners[a] + corners[b]) / 2 + bend, corners[b]]
    return np.column_stack([np.array(way), np.zeros(len(way))])


def _barn(rng: Rng) -> tuple[Mesh, float]:
    """A shed under a saddle roof, and the radius of the circle around it."""
    length, width, height = rng.uniform([10, 7, 3], [20, 11, 5])
    parts = [
        box(length, width, height + FOUNDATION_M, foot=-FOUNDATION_M),
        placed(gable(length + 0.8, width + 0.8, rng.uniform(1.5, 3)), 0, 0, height),
        placed(
            box(rng.uniform(2, 4), 3.0, height * 0.6 + FOUNDATION_M, foot=-FOUNDATION_M),
            length / 4,
            width / 2,
        ),
    ]
    return Mesh.joined(parts), float(np.hypot(length, width) / 2 + 1)


def _yard(place: Place, space: FreeSpace, rng: Rng, x: float, y: float) -> None:
    """Sheds at odd angles, a silo, trailers that may be gone another day."""
    for dx, dy in rng.uniform(-18, 18, (5, 2)):
        shape, radius = _barn(rng)
        if space.take(x + dx, y + dy, radius):
            place.fix(shape, x + dx, y + dy, 0, rng.uniform(0, 2 * np.pi))
    for dx, dy in rng.uniform(-20, 20, (4, 2)):
        if space.take(x + dx, y + dy, 2.5):
            place.fix(tank(1.6, rng.uniform(5, 8)), x + dx, y + dy, 0)
    for dx, dy in rng.uniform(-22, 22, (10, 2)):
        if space.take(x + dx, y + dy, 2.5):
            trailer = Mesh.joined([box(4.0, 2.0, 1.2, foot=0.6), box(0.8, 2.2, 0.7)])
            present = rng.uniform() < 0.6
            place.put(trailer, x + dx, y + dy, 0, rng.uniform(0, 2 * np.pi), present=present)


def _orchard(place: Place, space: FreeSpace, rng: Rng, x: float, y: float) -> None:
    """Rows of small trees, some of them missing."""
    turn = rng.uniform(0, np.pi)
    c, s = np.cos(turn), np.sin(turn)
    for row in np.arange(-18, 19, 6.0):
        for along in np.arange(-18, 19, 4.5):
            dx, dy = c * row - s * along, s * row + c * along
            if (
                max(abs(dx), abs(dy)) < FIELD_HALF_M
                and rng.uniform() < 0.85
                and space.take(x + dx, y + dy, 1.2)
            ):
                crown = blob(rng.uniform(1.0, 1.7), rng.uniform(1.8, 2.8), rng, roughness=0.25)
                stem = cylinder(0.12, 1.9, foot=-0.5, sides=6)
                place.fix(Mesh.joined([stem, placed(crown, 0, 0, 1.0)]), x + dx, y + dy)


def _bales(place: Place, space: FreeSpace, rng: Rng, x: float, y: float) -> None:
    """Round bales of straw, which are soon fetched, and a stack of square ones."""
    for dx, dy in rng.uniform(-FIELD_HALF_M, FIELD_HALF_M, (14, 2)):
        if space.take(x + dx, y + dy, 1.0):
            bale = placed(lying(cylinder(0.75, 1.2, sides=14)), -0.6, 0, 0.75)
            place.put(bale, x + dx, y + dy, 0, rng.uniform(0, 2 * np.pi), present=rng.uniform() < 0.8)
    dx, dy = rng.uniform(-12, 12, 2)
    if space.take(x + dx, y + dy, 5.0):
        place.fix(box(7.0, 3.0, 3.0 + 1.0, foot=-1.0), x + dx, y + dy, 0, rng.uniform(0, np.pi))


def _bounds(place: Place, space: FreeSpace, rng: Rng, x: float, y: float) -> None:
    """On each side of a field a hedge of bushes, a fence, a row of trees or nothing."""
    for side in range(4):
        kind = str(rng.choice(["hedge", "fence", "trees", "open"], p=[0.3, 0.2, 0.15, 0.35]))
        step_m = {"hedge": 1.6, "fence": 3.0, "trees": 7.0, "open": 24.0}[kind]
        for along in np.arange(-FIELD_HALF_M, FIELD_HALF_M, step_m):
            dx, dy = _turned(along, FIELD_HALF_M + 1.0 + rng.normal(0, 0.2), side)
            if rng.uniform() < 0.1:  # a gap
                continue
            if kind == "hedge" and space.take(x + dx, y + dy, 0.7):
                bush = blob(rng.uniform(0.9, 1.3), rng.uniform(1.4, 2.4), rng, roughness=0.3)
                place.fix(bush, x + dx, y + dy, -0.3)
            elif kind == "fence" and space.take(x + dx, y + dy, 0.3):
                rails = [box(3.0, 0.06, 0.14, foot=z) for z in (0.5, 1.0)]
                place.fix(
                    Mesh.joined([box(0.12, 0.12, 1.8, foot=-0.5), *rails]),
                    x + dx,
                    y + dy,
                    0,
                    side * np.pi / 2,
                )
            elif kind == "trees" and space.take(x + dx, y + dy, 0.8):
                place.fix(tree(rng), x + dx, y + dy, 0, rng.uniform(0, 2 * np.pi))


def _bushes(place: Place, space: FreeSpace, rng: Rng, x: float, y: float, *, count: int) -> None:
    """Bushes and single trees in a field."""
    for dx, dy in rng.uniform(-FIELD_HALF_M, FIELD_HALF_M, (count, 2)):
        if space.take(x + dx, y + dy, 1.5):
            single = (
                tree(rng) if rng.uniform() < 0.4 else blob(rng.uniform(0.6, 1.5), rng.uniform(0.8, 2.2), rng)
            )
            place.fix(single, x + dx, y + dy, -0.15)


def _woods(place: Place, space: FreeSpace, rng: Rng) -> None:
    """Trees and undergrowth along the edge of the farm, in clumps."""
    for clump in rng.uniform(-HALF_M, HALF_M, (9, 1)):
        cx, cy = _turned(float(clump[0]), HALF_M - 8.0, int(rng.integers(4)))
        for dx, dy in rng.normal(0, 6.0, (8, 2)):
            if space.take(cx + dx, cy + dy, 1.2):
                place.fix(tree(rng), cx + dx, cy + dy, 0, rng.uniform(0, 2 * np.pi))


def _turned(x: float, y: float, quarters: int) -> tuple[float, float]:
    for _ in range(quarters):
        x, y = -y, x
    return x, y
