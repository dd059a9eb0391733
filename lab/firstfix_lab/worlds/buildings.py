"""Houses of the campus. Each is a mesh about the origin and the spots (x, y) that it stands on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix_builder.mesh.mesh import Mesh
from firstfix_cli.sample_world.primitives import block, box, cylinder, gable, placed

BASEMENT_M = 5.0  # walls reach this far down, so that no gap opens on the low side of a slope

Rng = np.random.Generator
Building = tuple[Mesh, list[tuple[float, float]]]


def hall(rng: Rng) -> Building:
    """A long house under a saddle roof, a flat annex at one corner, a porch."""
    length, width, height = rng.uniform([20, 10, 5], [26, 14, 8])
    annex_l, annex_w, annex_h = rng.uniform([6, 5, 3], [10, 8, 4.5])
    side = float(rng.choice([-1, 1]))
    annex_x = rng.uniform(-0.35, 0.35) * length
    annex_y = side * (width + annex_w) / 2
    parts = [
        body(rng, length, width, height),
        placed(gable(length + 1, width + 1, rng.uniform(2, 4)), 0, 0, height),
        placed(box(1.0, 1.0, 2.5), rng.uniform(-0.3, 0.3) * length, 1.5, height + 1),
        placed(body(rng, annex_l, annex_w, annex_h), annex_x, annex_y),
        placed(porch(), rng.uniform(-0.3, 0.3) * length, -side * width / 2, 0, 0 if side > 0 else np.pi),
    ]
    return Mesh.joined(parts), [*_spots(length, width), (annex_x, annex_y)]


def court(rng: Rng) -> Building:
    """Three wings round a yard, none as high as the other, a stair tower in one corner."""
    length, depth, wing = rng.uniform([22, 20, 6], [27, 26, 8])
    heights = rng.uniform(6, 12, 3)
    arm = depth - wing
    parts = [placed(body(rng, length, wing, heights[0]), 0, (depth - wing) / 2)]
    for side, height in ((-1, heights[1]), (1, heights[2])):
        cut = arm * rng.uniform(0.6, 1.0)
        x, y = side * (length - wing) / 2, (depth / 2 - wing) - cut / 2
        parts.append(placed(body(rng, wing, cut, height), x, y))
    corner = float(rng.choice([-1, 1])) * (length / 2 - wing)
    parts.append(
        placed(cylinder(1.8, max(heights) + 2 + BASEMENT_M, foot=-BASEMENT_M), corner, depth / 2 - wing)
    )
    parts.append(placed(porch(), 0, depth / 2 - wing))
    return Mesh.joined(parts), _spots(length, depth)


def tower(rng: Rng) -> Building:
    """A block of several storeys with balconies and plant on its roof, beside it a low pavilion."""
    length, width, height = rng.uniform([12, 10, 11], [16, 13, 19])
    x = -5.0
    pavilion_l, pavilion_w = rng.uniform([7, 8], [10, 14])
    pavilion_x = x + (length + pavilion_l) / 2
    parts = [
        placed(body(rng, length, width, height), x, 0),
        placed(box(4, 3, 2.4), x + 1, rng.uniform(-2, 2), height),
        placed(body(rng, pavilion_l, pavilion_w, 3.6), pavilion_x, rng.uniform(-3, 3)),
    ]
    side = float(rng.choice([-1, 1]))
    for z in np.arange(3.0, height - 2, 3.0):
        for dx in (-0.3, 0.25):
            balcony = Mesh.joined([box(3.0, 1.4, 0.2), placed(box(3.0, 0.08, 1.0), 0, side * 0.66, 0.2)])
            parts.append(placed(balcony, x + dx * length, side * (width / 2 + 0.7), z))
    return Mesh.joined(parts), [*_spots(length, width, x), *_spots(pavilion_l, pavilion_w, pavilion_x)]


def body(rng: Rng, length: float, width: float, height: float) -> Mesh:
    """A block with a plinth, pilasters between its windows, window bays and an eave."""
    bay = rng.uniform(2.6, 4.2)
    parts = [
        box(length, width, height + BASEMENT_M, foot=-BASEMENT_M),
        box(length + 0.3, width + 0.3, 0.8 + BASEMENT_M, foot=-BASEMENT_M),
        box(length + 0.8, width + 0.8, 0.25, foot=height - 0.25),
    ]
    for extent, other, turn in ((length, width, 0.0), (width, length, np.pi / 2)):
        edges = np.linspace(-extent / 2, extent / 2, max(2, round(extent / bay)) + 1)
        for sign in (-1, 1):
            facade = [placed(box(0.5, 0.4, height), float(s), 0) for s in edges]
            facade += _window_bays(rng, (edges[1:] + edges[:-1]) / 2, height)
            parts.append(_on_side(Mesh.joined(facade), sign * other / 2, turn))
    return Mesh.joined(parts)


def porch() -> Mesh:
    """Steps, a canopy and two posts, on the -y side of the origin."""
    steps = [block([-1.6, -2.4 + 0.5 * k, -BASEMENT_M], [1.6, 0, 0.16 * (k + 1)]) for k in range(3)]
    posts = [placed(cylinder(0.14, 3.0, sides=8), sx * 1.4, -1.9) for sx in (-1, 1)]
    return Mesh.joined([*steps, *posts, block([-1.8, -2.3, 3.0], [1.8, 0, 3.25])])


def _window_bays(rng: Rng, middles: NDArray[np.float64], height: float) -> list[Mesh]:
    """Bays standing out of a facade here and there: no two facades are alike."""
    return [
        placed(box(1.4, rng.uniform(0.3, 0.9), 1.6), float(s), 0, z)
        for s in middles
        for z in np.arange(1.2, height - 1.8, 3.0)
        if rng.uniform() < 0.3
    ]


def _on_side(facade: Mesh, offset: float, turn: float) -> Mesh:
    """A facade along x, moved out to the side that lies offset from the middle, then turned."""
    return placed(placed(facade, 0, offset), 0, 0, 0, turn)


def _spots(length: float, width: float, x: float = 0.0) -> list[tuple[float, float]]:
    """Point at most 5 m apart over a rectangle about (x, 0)."""
    across = np.linspace(-0.5, 0.5, int(np.ceil(length / 5)) + 1) * length
    along = np.linspace(-0.5, 0.5, int(np.ceil(width / 5)) + 1) * width
    return [(float(x + a), float(b)) for a in across for b in along]
