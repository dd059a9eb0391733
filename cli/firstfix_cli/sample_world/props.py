"""Things that stand in the sample worlds: furniture, goods, machines, cars, trees, people.

Each is a mesh on the origin of its own frame; sizes in metres.
"""

from __future__ import annotations

import numpy as np

from firstfix_builder.mesh.mesh import Mesh

from .primitives import blob, block, box, cylinder, frustum, lying, placed

Rng = np.random.Generator


def person(rng: Rng) -> Mesh:
    """A passer-by: legs, trunk and head fill about 0.5 x 0.5 x 1.75."""
    height = rng.uniform(1.6, 1.9)
    return Mesh.joined(
        [
            placed(cylinder(0.13, height * 0.5, sides=8), 0.0, 0.12),
            placed(cylinder(0.13, height * 0.5, sides=8), rng.uniform(-0.2, 0.2), -0.12),
            box(0.32, 0.52, height * 0.36, foot=height * 0.48),
            cylinder(0.12, height * 0.16, foot=height * 0.84, sides=8),
        ]
    )


# Indoors


def desk(length: float = 1.6, width: float = 0.8) -> Mesh:
    """A table top on two side panels, with a screen and a drawer unit; one sits on its -y side."""
    top = 0.72
    return Mesh.joined(
        [
            box(length, width, 0.04, foot=top),
            placed(box(0.04, width * 0.9, top), -length / 2 + 0.04, 0),
            placed(box(0.04, width * 0.9, top), length / 2 - 0.04, 0),
            placed(box(0.42, 0.55, 0.58), length / 2 - 0.3, 0),
            placed(box(0.55, 0.05, 0.36, foot=top + 0.12), 0, width * 0.25),
            placed(box(0.2, 0.16, 0.12, foot=top + 0.02), 0, width * 0.25),
        ]
    )


def chair() -> Mesh:
    """An office chair; its back is on the -y side."""
    return Mesh.joined(
        [
            cylinder(0.3, 0.08, sides=5),
            cylinder(0.04, 0.4, sides=6),
            box(0.48, 0.48, 0.08, foot=0.42),
            placed(box(0.44, 0.06, 0.5, foot=0.5), 0, -0.24),
        ]
    )


def table(length: float, width: float) -> Mesh:
    """A table with four legs."""
    legs = [
        placed(box(0.06, 0.06, 0.72), sx * (length / 2 - 0.1), sy * (width / 2 - 0.1))
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return Mesh.joined([box(length, width, 0.05, foot=0.72), *legs])


def cabinet(length: float, depth: float, height: float) -> Mesh:
    """A closed cabinet on a plinth."""
    return Mesh.joined([box(length, depth - 0.06, height - 0.06, foot=0.06), box(length - 0.06, depth, 0.06)])


def bookcase(length: float, height: float, rng: Rng) -> Mesh:
    """Open shelves against a wall on its +y side, books of uneven depth on every board."""
    depth, levels = 0.34, int(height / 0.38)
    parts = [block([-length / 2, depth / 2 - 0.02, 0], [length / 2, depth / 2, height])]
    parts += [placed(box(0.03, depth, height), sx * length / 2, 0) for sx in (-1, 1)]
    for level in range(levels + 1):
        z = level * (height - 0.03) / levels
        parts.append(box(length, depth, 0.03, foot=z))
        if level < levels and rng.uniform() < 0.8:
            start = rng.uniform(-0.45, 0.0) * length
            end = start + rng.uniform(0.3, 0.5) * length
            parts.append(block([start, -depth / 2 + rng.uniform(0.04, 0.14), z + 0.03], [end, 0.15, z + 0.3]))
    return Mesh.joined(parts)


def plant(rng: Rng) -> Mesh:
    """A plant in a pot."""
    leaves = placed(blob(rng.uniform(0.2, 0.32), rng.uniform(0.8, 1.2), rng, roughness=0.25), 0, 0, 0.5)
    return Mesh.joined([cylinder(0.18, 0.4, top_radius=0.24, sides=8), cylinder(0.03, 0.6, sides=5), leaves])


# The factory floor


def pallet(rng: Rng, *, height: float | None = None) -> Mesh:
    """A Euro pallet with its load."""
    load = rng.uniform(0.3, 1.4) if height is None else height
    return Mesh.joined([box(1.2, 0.8, 0.14), box(1.16, 0.78, load, foot=0.16)])


def forklift() -> Mesh:
    """A parked forklift."""
    mast = [placed(box(0.1, 0.12, 2.2), 1.05, side * 0.35) for side in (-1, 1)]
    forks = [placed(box(1.1, 0.12, 0.05, foot=0.06), 1.6, side * 0.25) for side in (-1, 1)]
    posts = [
        placed(box(0.07, 0.07, 1.1, foot=1.0), sx, side * 0.45) for sx in (-0.5, 0.75) for side in (-1, 1)
    ]
    body = [box(1.9, 1.1, 0.8, foot=0.2), placed(box(0.6, 1.1, 0.3, foot=0.9), -0.65, 0)]
    roof = [placed(box(1.4, 1.0, 0.06, foot=2.1), 0.1, 0)]
    return Mesh.joined([*body, *posts, *roof, *mast, *forks])


def machine(rng: Rng) -> Mesh:
    """A machining centre: housing, control panel, chip conveyor, a tank or a tower on top."""
    length, width, height = rng.uniform([2.6, 1.8, 1.8], [4.2, 2.6, 2.6])
    parts = [
        box(length, width, height),
        placed(box(length * 0.5, width * 0.6, 0.5, foot=height), rng.uniform(-0.6, 0.6), 0),
        placed(box(0.5, 0.35, 1.5), length * 0.3, -width / 2 - 0.35),
        placed(box(1.4, 0.6, 0.9), -length / 2 - 0.7, rng.uniform(-0.4, 0.4)),
    ]
    if rng.uniform() < 0.5:
        parts.append(placed(cylinder(0.45, rng.uniform(0.8, 1.6), foot=height), -length * 0.3, width * 0.1))
    if rng.uniform() < 0.5:
        parts.append(placed(cylinder(0.5, rng.uniform(1.6, 2.8)), length / 2 + 0.65, width * 0.2))
    return Mesh.joined(parts)


def conveyor(length: float) -> Mesh:
    """A roller track along x at 0.8 m."""
    legs = [
        placed(box(0.08, 0.08, 0.7), x, side * 0.4)
        for x in np.arange(-length / 2 + 0.3, length / 2, 1.5)
        for side in (-1, 1)
    ]
    rails = [placed(box(length, 0.06, 0.22, foot=0.68), 0, side * 0.42) for side in (-1, 1)]
    return Mesh.joined([box(length, 0.8, 0.06, foot=0.74), *rails, *legs])


def tank(radius: float, height: float) -> Mesh:
    """A silo on three legs, with a domed top and a pipe along it."""
    legs = [
        placed(box(0.16, 0.16, 0.9), radius * 0.75 * np.cos(a), radius * 0.75 * np.sin(a))
        for a in np.arange(3) * 2 * np.pi / 3
    ]
    return Mesh.joined(
        [
            cylinder(radius * 0.3, 0.5, top_radius=radius, foot=0.5, sides=20),
            cylinder(radius, height - 1.4, foot=1.0, sides=20),
            cylinder(radius, 0.4, top_radius=radius * 0.4, foot=height - 0.4, sides=20),
            placed(cylinder(0.08, height + 0.6, sides=6), radius + 0.15, 0),
            *legs,
        ]
    )


# Outdoors


def car(rng: Rng) -> Mesh:
    """Body, tapering cabin and wheels: a saloon, or a van now and then."""
    van = rng.uniform() < 0.2
    length, width = (5.2, 1.95) if van else (rng.uniform(3.8, 4.7), 1.8)
    a, b = length / 2, width / 2
    front, back, roof = (a - 0.9, -a + 0.1, 1.25) if van else (a - 1.2, -a + 0.5, 0.6)
    foot = [[back - 0.05, -b], [front, -b], [front, b], [back - 0.05, b]]
    top = [
        [back + 0.15, -b + 0.15],
        [front - 0.6, -b + 0.15],
        [front - 0.6, b - 0.15],
        [back + 0.15, b - 0.15],
    ]
    wheels = [
        placed(lying(cylinder(0.32, 0.2, sides=10)), x, y, 0.32, np.pi / 2)
        for x in (-a + 0.85, a - 0.85)
        for y in (-b, b - 0.2)
    ]
    return Mesh.joined([box(length, width, 0.62, foot=0.28), frustum(foot, roof, top=top, foot=0.9), *wheels])


def tree(rng: Rng) -> Mesh:
    """Broad-leaved, with a few lobes to its crown, or a conifer."""
    height, trunk = rng.uniform(5, 12), rng.uniform(0.12, 0.3)
    if rng.uniform() < 0.25:
        tiers = [
            placed(cylinder(height * (0.22 - 0.05 * k), height * 0.36, top_radius=0.05, sides=10), 0, 0, z)
            for k, z in enumerate(height * np.array([0.2, 0.42, 0.64]))
        ]
        return Mesh.joined([cylinder(trunk, height * 0.4, foot=-0.5, sides=8), *tiers])
    crown = [blob(height * 0.26, height * 0.55, rng, roughness=0.2)]
    for _ in range(int(rng.integers(1, 4))):
        side, angle = height * rng.uniform(0.12, 0.2), rng.uniform(0, 2 * np.pi)
        lobe = blob(height * 0.16, height * 0.3, rng, roughness=0.25)
        crown.append(placed(lobe, side * np.cos(angle), side * np.sin(angle), height * rng.uniform(0, 0.25)))
    stem = cylinder(trunk, height * 0.5 + 0.5, top_radius=trunk * 0.6, foot=-0.5, sides=8)
    return Mesh.joined([stem, placed(Mesh.joined(crown), 0, 0, height * 0.42)])


def lamp_post() -> Mesh:
    """A street lamp."""
    arm = placed(box(1.2, 0.08, 0.08, foot=5.4), 0.5, 0)
    return Mesh.joined(
        [
            cylinder(0.08, 5.9, top_radius=0.05, foot=-0.4, sides=8),
            arm,
            placed(box(0.5, 0.2, 0.1, foot=5.32), 1.0, 0),
        ]
    )


def bench() -> Mesh:
    """A park bench."""
    feet = [placed(box(0.08, 0.45, 0.65, foot=-0.2), x, 0) for x in (-0.7, 0.7)]
    return Mesh.joined(
        [box(1.8, 0.45, 0.06, foot=0.42), placed(box(1.8, 0.05, 0.4, foot=0.5), 0, 0.22), *feet]
    )
