"""The visible points of a place with known walls, and the sides they are seen from."""

import numpy as np
from scipy.spatial import cKDTree

from firstfix.sensor import preset
from firstfix_builder.index import visible_points as visible_points_module
from firstfix_builder.index.visible_points import map_surface, visible_points
from firstfix_builder.simulation.simulate import Simulator

SENSOR = preset("os0-64")


def box(low, high):
    """Vertices and triangles of a closed box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return np.array(low) + corners * (np.array(high) - low), triangles


def two_rooms() -> Simulator:
    """A hall of 8 by 4 by 3 m with a wall across, 0.2 m thick."""
    hall, wall = box([0, 0, 0], [8, 4, 3]), box([3.9, 0, 0], [4.1, 4, 3])
    return Simulator(np.concatenate([hall[0], wall[0]]), np.concatenate([hall[1], wall[1] + 8]))


VIEWPOINTS = np.array([[1.5, 2, 1], [2.5, 2, 1], [5.5, 2, 1], [6.5, 2, 1]])


def test_points_lie_on_what_is_seen_and_know_from_where():
    (seen,) = visible_points(two_rooms(), VIEWPOINTS, SENSOR, 0.1)
    points, to_viewer = seen[:, :3], seen[:, 3:]
    inside = (points > -0.01).all(axis=1) & (points < np.array([8, 4, 3]) + 0.01).all(axis=1)
    assert inside.all()
    west = np.abs(points[:, 0] - 3.9) < 0.02
    east = np.abs(points[:, 0] - 4.1) < 0.02
    assert west.sum() > 300
    assert east.sum() > 300
    assert (to_viewer[west, 0] < 0).all()
    assert (to_viewer[east, 0] > 0).all()
    assert not ((points[:, 0] > 3.93) & (points[:, 0] < 4.07)).any()  # nothing within the wall


def test_the_map_has_what_other_sensors_see():
    """A VLP-16 sees floor and ceiling from afar alone; an OS0 in the same place sees them above and below."""
    surface = map_surface(None, two_rooms(), VIEWPOINTS, preset("vlp-16"), 0.1, 0.12)
    x, y, z = surface.points.T
    for level in (0, 3):
        here = np.abs(z - level) < 0.02
        assert cKDTree(np.column_stack([x, y])[here]).query(VIEWPOINTS[:, :2])[0].max() < 0.15


def test_the_surface_of_a_mesh_faces_those_who_see_it():
    surface = map_surface(None, two_rooms(), VIEWPOINTS, SENSOR, 0.1, 0.12)
    x = surface.points[:, 0]
    middle = (np.abs(surface.points[:, 1] - 2) < 1.5) & (np.abs(surface.points[:, 2] - 1.5) < 1)
    west, east = middle & (np.abs(x - 3.9) < 0.03), middle & (np.abs(x - 4.1) < 0.03)
    assert surface.oriented[west | east].mean() > 0.95
    assert np.median(surface.normals[west, 0]) < -0.95
    assert np.median(surface.normals[east, 0]) > 0.95


def test_a_cloud_learns_its_faces_and_keeps_what_nobody_sees():
    rng = np.random.default_rng(1)
    west = np.column_stack([np.full(600, 3.91), rng.uniform([0.5, 0.5], [3.5, 2.5], (600, 2))])
    unseen = np.column_stack([rng.uniform([20, 0], [22, 2], (300, 2)), np.zeros(300)])
    surface = map_surface(np.concatenate([west, unseen]), two_rooms(), VIEWPOINTS, SENSOR, 0.1, 0.05)
    on_wall = surface.points[:, 0] < 10
    assert surface.oriented[on_wall].mean() > 0.95
    assert np.median(surface.normals[on_wall, 0]) < -0.95
    assert not surface.oriented[~on_wall].any()
    assert (~on_wall).sum() > 200


def test_block_by_block_the_same_is_seen(monkeypatch):
    whole = map_surface(None, two_rooms(), VIEWPOINTS, SENSOR, 0.1, 0.12)
    monkeypatch.setattr(visible_points_module, "BLOCK_M", 2.0)
    monkeypatch.setattr(visible_points_module, "AT_ONCE", 1)
    parted = map_surface(None, two_rooms(), VIEWPOINTS, SENSOR, 0.1, 0.12)
    away_m, row = cKDTree(whole.points).query(parted.points)
    assert abs(len(parted) - len(whole)) < 0.1 * len(whole)
    assert np.percentile(away_m, 99) < 0.1
    alike = np.einsum("ij,ij->i", parted.normals, whole.normals[row])
    assert (np.abs(alike) > 0.9).mean() > 0.95  # the others stand in corners
    assert (alike[parted.oriented & whole.oriented[row]] > 0).mean() > 0.97


def two_storeys() -> tuple[Simulator, np.ndarray]:
    """A building of 24 by 12 m, both of whose storeys look alike, and its viewpoints column by column."""
    lower, upper = box([0, 0, 0], [24, 12, 2.8]), box([0, 0, 3], [24, 12, 5.8])
    simulator = Simulator(np.concatenate([lower[0], upper[0]]), np.concatenate([lower[1], upper[1] + 8]))
    columns = [[x, y, z] for x in np.arange(1, 24) for y in np.arange(1, 12) for z in (1.0, 4.0)]
    return simulator, np.array(columns)


def test_no_storey_is_passed_over(monkeypatch):
    """Each storey is looked at as well as the other, although not all viewpoints are used."""
    simulator, viewpoints = two_storeys()
    monkeypatch.setattr(visible_points_module, "VIEWPOINTS", -(-len(viewpoints) // 4))
    looked_from = []
    ranges = simulator.ranges
    monkeypatch.setattr(simulator, "ranges", lambda T, *rays: looked_from.append(T) or ranges(T, *rays))
    (seen,) = visible_points(simulator, viewpoints, SENSOR, 0.05)
    z = np.concatenate(looked_from)[:, 2, 3]
    assert 0.4 < (z < 2).mean() < 0.6
    points_below = (seen[:, 2] < 2.9).mean()
    assert 0.45 < points_below < 0.55
