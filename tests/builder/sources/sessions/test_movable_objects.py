from __future__ import annotations

import numpy as np

from firstfix.engine.registration.surface import Surface
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.sources.sessions.session_map import MovableObjects
from tests.builder.box_scenes import box, floor, sampled, walls

CUPBOARD = box((4, 3, 0), (5, 3.6, 1.8))
ROOM = Mesh.joined([floor(0, 0, 10, 7), *walls(0, 0, 10, 7)])


def test_things_stand_between_floor_and_ceiling_and_are_no_walls():
    points = sampled(Mesh.joined([ROOM, CUPBOARD]), 150)
    things = MovableObjects(Surface.around(points))
    low, high = CUPBOARD.vertices.min(axis=0), CUPBOARD.vertices.max(axis=0)
    of_cupboard = np.all((points >= low - 0.01) & (points <= high + 0.01), axis=1) & (points[:, 2] > 0.25)
    found = things.among(points, floor_z=0.0)
    assert found[of_cupboard].mean() > 0.95
    wall = (points[:, 2] > 0.3) & ~of_cupboard & (np.abs(points[:, 0] - 5) > 2)
    assert found[wall].mean() < 0.05
    assert not found[points[:, 2] < 0.1].any()
    assert not things.among(points, floor_z=5.0).any()


def test_nothing_upright_and_points_outside():
    flat = Surface.around(sampled(floor(0, 0, 10, 7), 50))
    assert MovableObjects(flat).among(np.array([[500.0, 500.0, 1.0]]), 0.0).all()
