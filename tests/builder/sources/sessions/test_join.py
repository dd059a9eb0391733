from __future__ import annotations

import numpy as np

from firstfix.engine.registration.surface import Surface
from firstfix.transform import inverse, make_transform, rotation_z, transform_points
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.sources.sessions.join import PlacedSurface
from tests.builder.box_scenes import box, floor, sampled, walls

SCENE = Mesh.joined(
    [floor(0, 0, 14, 9), *walls(0, 0, 14, 9), box((3, 2, 0), (4, 3.2, 1.1)), box((9, 5, 0), (9.8, 7, 1.6))]
)
VIEWER = np.array([7.0, 4.5, 1.2])
T_TRUE = make_transform(rotation_z(1.2), [400.0, -250.0, 3.0])  # far off: float32 would not do


def surface(seed, per_m2=60, where=lambda p: np.ones(len(p), bool), T=np.eye(4)):
    """The inner surface, in the left frame of T."""
    points = sampled(SCENE, per_m2, seed)
    inside = (points[:, 0] > -0.01) & (points[:, 0] < 14.01) & (points[:, 1] > -0.01) & (points[:, 1] < 9.01)
    points = points[inside & (points[:, 2] >= 0) & where(points)]
    toward = VIEWER - points
    return Surface.around(transform_points(T, points), toward @ T[:3, :3].T)


def test_a_start_half_a_metre_off_ends_within_millimetres():
    placed = PlacedSurface(surface(1))
    T_session = inverse(T_TRUE)
    off = make_transform(rotation_z(np.radians(2)), [0.3, -0.3, 0.1])
    about = make_transform(np.eye(3), VIEWER)
    found = placed.join(surface(2, T=T_TRUE), about @ off @ inverse(about) @ T_session)
    corners = np.array([[x, y, z] for x in (0, 14) for y in (0, 9) for z in (0, 3)], float)
    away = transform_points(found @ T_TRUE, corners) - corners
    assert np.linalg.norm(away, axis=1).max() < 0.005


def test_overlap_is_the_share_that_has_a_pair():
    placed = PlacedSurface(surface(1, where=lambda p: p[:, 0] < 7))
    whole = surface(2)
    found = placed.overlap(whole, np.eye(4))
    west = (whole.points[:, 0] < 7).mean()
    assert abs(found.share - west) < 0.05
    assert found.residual_m < 0.01
    assert found.paired_m[:, 0].max() < 7.5


def test_surfaces_apart_have_no_overlap():
    found = PlacedSurface(surface(1)).overlap(surface(2), make_transform(np.eye(3), [100.0, 0, 0]))
    assert found.share == 0
    assert found.residual_m == np.inf
    T = make_transform(np.eye(3), [100.0, 0, 0])
    np.testing.assert_array_equal(PlacedSurface(surface(1)).join(surface(2), T), T)
