"""A world that has more than the map, and less: exact, and the same for every ray of a scan."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.builds.config import PerturbConfig
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.simulation.changed_world import Sight, changed_ranges, ranges_without, what_left
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator

SENSOR = SensorModel("rings", tuple(np.linspace(-40, 40, 17).tolist()), 2.0, 0.1, 60.0, 0.8)
ROOM = ([0, 0, 1.5], [6, 4, 1.5], 0.0)  # a box seen from inside
CABINET = ([3, 1, 1.0], [0.4, 0.8, 1.0], 0.3)
T = make_transform(rotation_z(0.4), [0.5, -0.2, 0.8])


def boxes(*parts: tuple[list[float], list[float], float]) -> Boxes:
    centre, half, yaw = zip(*parts, strict=True)
    return Boxes(np.array(centre, float), np.array(half, float), np.array(yaw, float))


def world(*parts: tuple[list[float], list[float], float], without: int | None = None) -> Simulator:
    """Returns boxes as a mesh. Quad number ``without`` of them is missing: a hole."""
    vertices, triangles = boxes(*parts).mesh()
    if without is not None:
        triangles = np.delete(triangles, [2 * without, 2 * without + 1], axis=0)
    return Simulator(vertices, triangles)


def sight(simulator: Simulator, pose: np.ndarray = T) -> Sight:
    rays = Rays.of_sensor(SENSOR)
    return Sight(pose, rays.turned(pose), next(simulator.ranges(pose[None], SENSOR, rays))[0])


def test_boxes_contain_what_lies_in_their_mesh():
    some = boxes(CABINET, ([-2, 0, 1], [1, 0.2, 1], 1.1))
    points = np.random.default_rng(0).uniform([-4, -3, -1], [4, 3, 3], (4000, 3))
    inside = some.contain(points)
    vertices, triangles = some.mesh()
    scene = Simulator(vertices, triangles).scene
    from firstfix_builder.mesh.open3d_core import o3d

    occupied = scene.compute_occupancy(o3d.core.Tensor(points.astype(np.float32))).numpy() > 0
    assert np.array_equal(inside, occupied)
    assert 20 < inside.sum() < 2000
    assert not Boxes.none().contain(points).any()


def test_what_leaves_shows_what_is_behind_it():
    here = sight(world(ROOM, CABINET))
    around = boxes((CABINET[0], [0.41, 0.81, 1.01], CABINET[2]))
    found = ranges_without(world(ROOM, CABINET), SENSOR, here, around)
    wanted = sight(world(ROOM)).ranges
    # the walls are those of the room alone, and its floor below the cabinet is gone with it
    off = np.abs(found - wanted) > 1e-3
    ends = here.ends_m(np.arange(len(wanted)), wanted)
    assert np.array_equal(off, off & around.contain(ends))
    changed = np.abs(found - here.ranges) > 1e-3
    assert changed.sum() > 50
    assert ranges_without(world(ROOM, CABINET), SENSOR, here, Boxes.none()) is not here.ranges


def test_the_floor_of_what_leaves_stays():
    here = sight(world(ROOM, CABINET))
    for seed in range(20):
        left = what_left(here, 6, np.random.default_rng(seed))
        assert len(left) == 6
        assert (left.centre_m[:, 2] - left.half_m[:, 2]).min() > 0.1
    assert len(what_left(here, 0, np.random.default_rng(0))) == 0


def test_a_hole_is_below_a_surface_and_the_sky_is_not():
    closed = sight(world(ROOM))
    assert not closed.holes(closed.ranges).any()
    open_above = sight(world(ROOM, without=5))  # the ceiling
    assert np.isinf(open_above.ranges).mean() > 0.2
    assert open_above.holes(open_above.ranges).mean() < 0.003  # at the edge of the walls
    with_window = closed.ranges.copy()
    ends = closed.ends_m(np.arange(len(with_window)), with_window)
    window = (ends[:, 0] > 5.99) & (np.abs(ends[:, 1]) < 2) & (np.abs(ends[:, 2] - 1.5) < 0.7)
    with_window[window] = np.inf
    assert np.array_equal(closed.holes(with_window), window)
    assert window.sum() > 20


@pytest.fixture(scope="module")
def with_a_hole() -> Simulator:
    """Two rooms. Of the first one a wall was never mapped, and its ceiling juts out over the hole."""
    roof = ([3, 0, 3.05], [9, 4, 0.05], 0.0)
    other = ([40, 0, 1.5], [5, 4, 1.5], 0.0)
    vertices, triangles = boxes(ROOM, roof, other).mesh()
    return Simulator(vertices, np.delete(triangles, [2, 3], axis=0))


def test_a_map_without_holes_gets_nothing_unmapped():
    room = world(ROOM, CABINET)
    config = PerturbConfig(unmapped=50, vanished=0)
    found = changed_ranges(room, SENSOR, sight(room), np.zeros((3, 3)), config, np.random.default_rng(1))
    assert np.array_equal(found, sight(room).ranges)


def test_what_was_never_mapped_looks_like_another_place(with_a_hole: Simulator):
    here = sight(with_a_hole)
    holes = here.holes(here.ranges)
    assert holes.mean() > 0.03
    elsewhere = np.array([[39.0, 0.5, 0.8], [41.0, 0.0, 0.8]])
    config = PerturbConfig(unmapped=2, vanished=0)
    found = changed_ranges(with_a_hole, SENSOR, here, elsewhere, config, np.random.default_rng(2))
    assert np.isfinite(found[holes]).all()  # the other place is closed all around
    assert (found <= here.ranges).all()
    stopped = found < here.ranges
    there = [
        sight(with_a_hole, make_transform(rotation_z(0.4 + quarter * np.pi / 2), at)).ranges
        for at in elsewhere
        for quarter in range(4)
    ]
    assert any(np.allclose(found[stopped], one[stopped], atol=1e-4) for one in there)


def test_some_of_the_rays_return_what_they_return_among_all(with_a_hole: Simulator):
    whole = sight(with_a_hole)
    chosen = np.random.default_rng(6).random(len(whole.rays)) < 0.3
    some = whole.rays.of_rows(chosen)
    assert np.array_equal(np.sort(some.order), np.arange(chosen.sum()))
    found = next(with_a_hole.ranges(make_transform(np.eye(3), T[:3, 3])[None], SENSOR, some))[0]
    assert np.array_equal(found, whole.ranges[chosen])


def test_nothing_changes_where_nothing_is_asked_for(with_a_hole: Simulator):
    config = PerturbConfig(unmapped=0, vanished=0)
    here = sight(with_a_hole)
    found = changed_ranges(with_a_hole, SENSOR, here, np.zeros((1, 3)), config, np.random.default_rng(3))
    assert np.array_equal(found, here.ranges)


def test_scans_vary_from_no_change_to_much(with_a_hole: Simulator):
    still = {"noise_m": 0, "dropout": 0, "occluders": 0, "strangers": 0, "tilt_deg": 0, "height_m": 0}
    changed = ScanSimulation(with_a_hole, SENSOR, PerturbConfig(**still, unmapped=3, vanished=1))
    mapped = ScanSimulation(with_a_hole, SENSOR, PerturbConfig(**still, unmapped=0, vanished=0))
    around = np.array([[0, 0, 0.8], [2, 1, 0.8], [40, 1, 0.8], [41, 1, 0.8]])
    cases = changed.cases(around, 1.0, 60, np.random.default_rng(4))
    assert all(np.linalg.norm(c.elsewhere_m - c.T_level_sensor[:3, 3], axis=1).min() > 3 for c in cases)
    more = np.array([len(changed.scan(c).points) - len(mapped.scan(c).points) for c in cases])
    off = [
        not np.array_equal(changed.scan(c).points, mapped.scan(c).points)
        for c in cases
        if c.T_level_sensor[0, 3] > 10  # in the closed room only what leaves changes the scan
    ]
    assert 0.05 < np.mean(off) < 0.95
    assert more.max() > 30
