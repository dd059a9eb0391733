from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.errors import BuildFailed
from firstfix.transform import make_transform
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.viewpoints import tiles
from firstfix_builder.viewpoints.sample import Viewpoints, sample_viewpoints
from firstfix_builder.viewpoints.seen_floor import is_sparse
from tests.builder.box_scenes import box, floor, quad, walls
from tests.needs import recorded

MOUNT_M = 0.6


def sample(
    parts: list[Mesh],
    trajectory: NDArray[np.float64] | None = None,
    **config: object,
) -> Viewpoints:
    mesh = Mesh.joined(parts)
    chosen = ViewpointConfig.model_validate(config)
    return sample_viewpoints(Simulator(mesh.vertices, mesh.triangles), chosen, MOUNT_M, trajectory)


def path(*positions: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.stack([make_transform(np.eye(3), position) for position in positions])


def inside(found: Viewpoints, x0: float, y0: float, x1: float, y1: float) -> NDArray[np.bool_]:
    x, y = found.positions[:, 0], found.positions[:, 1]
    return (x > x0) & (x < x1) & (y > y0) & (y < y1)


def room(x: float = 10.0, y: float = 8.0) -> list[Mesh]:
    return [floor(0, 0, x, y), *walls(0, 0, x, y), floor(0, 0, x, y, 3.0)]


def test_an_empty_room_gets_one_viewpoint_a_square_metre():
    found = sample(room())
    assert len(found) == 80
    np.testing.assert_allclose(found.floor_z, 0, atol=1e-6)
    np.testing.assert_allclose(found.positions[:, 2], MOUNT_M, atol=1e-6)
    np.testing.assert_allclose(np.sort(np.unique(found.positions[:, 0].round(6))), np.arange(10) + 0.5)


def test_nothing_stands_on_or_under_a_table_or_in_a_block():
    table = [box((3, 3, 0.7), (5, 5, 0.75))]
    block = [box((6, 2, -0.1), (8, 5, 2.0))]
    found = sample([*room(), *table, *block])
    assert not inside(found, 2.71, 2.71, 5.29, 5.29).any()
    assert not inside(found, 5.71, 1.71, 8.29, 5.29).any()
    assert np.abs(found.floor_z).max() < 1e-6
    assert inside(found, 0, 0, 2.7, 8).sum() >= 16  # the free part of the room is covered


def test_no_block_of_the_floor_is_left_out_beside_an_obstacle():
    found = sample([*room(), box((4, 0, -0.1), (4.2, 7, 3))])
    for x0 in (0, 1, 2, 3, 4.2, 5, 6, 7, 8, 9):
        assert inside(found, x0, 0, x0 + 1, 8).sum() >= 8


def test_both_storeys_are_reached_over_the_stairs():
    steps = 18
    stairs = [
        box((2 + 0.28 * i, 1, 0.17 * i), (2 + 0.28 * (i + 1), 2.4, 0.17 * (i + 1))) for i in range(steps)
    ]
    top = 0.17 * steps
    end = 2 + 0.28 * steps
    # the slab is open above the stairs
    slab = [
        box((end, 0, top - 0.1), (12, 8, top)),
        box((0, 2.4, top - 0.1), (end, 8, top)),
    ]
    house = [floor(0, 0, 12, 8), *walls(0, 0, 12, 8, 2 * top), floor(0, 0, 12, 8, 2 * top)]
    found = sample([*house, *stairs, *slab], trajectory=path((0.5, 6, 0.6), (1.5, 6, 0.6)))
    lower, upper = found.floor_z < 0.05, np.abs(found.floor_z - top) < 0.05
    assert lower.sum() > 50
    assert upper.sum() > 50
    assert (~lower & ~upper & inside(found, 2, 1, end, 2.4)).sum() >= 4  # on the stairs
    assert not (found.floor_z > top + 0.1).any()  # not on the roof
    without_stairs = sample([*house, *slab], trajectory=path((0.5, 6, 0.6), (1.5, 6, 0.6)))
    assert without_stairs.floor_z.max() < 0.05


def test_storeys_without_stairs_are_both_found_when_nothing_says_where_the_robot_was():
    found = sample([*room(), floor(0, 0, 10, 8, 3.1), floor(0, 0, 10, 8, 6), *walls(0, 0, 10, 8, 6)])
    lower, upper = np.abs(found.floor_z) < 0.01, np.abs(found.floor_z - 3.1) < 0.01
    assert lower.sum() == upper.sum() == 80
    assert len(found) == 160  # the roof at 6 m has none


def test_a_storey_whose_ceiling_the_map_lacks_is_no_roof():
    """Rooms with furniture in both storeys. Nobody mapped the upper one's ceiling."""
    upper = [
        floor(0, 0, 10, 8, 3.1),
        *walls(0, 0, 10, 8, 5.5),
        box((4.9, 0, 3.0), (5.1, 3, 5.5)),
        box((4.9, 4.2, 3.0), (5.1, 8, 5.5)),
        box((1, 1, 3.0), (2.5, 2, 3.8)),
        box((7, 5, 3.0), (9, 6, 4.1)),
    ]
    found = sample([*room(), *upper])
    lower, high = np.abs(found.floor_z) < 0.01, np.abs(found.floor_z - 3.1) < 0.01
    assert lower.sum() == 80
    assert high.sum() > 65
    assert (lower | high).all()


@pytest.mark.parametrize("parapet_m", [0.0, 0.4, 1.1])
def test_a_roof_is_none_though_things_stand_on_it(parapet_m: float):
    """A parapet, the house of a lift and a unit: no robot drives there."""
    roof = [
        floor(0, 0, 10, 8, 3.1),
        *walls(0, 0, 10, 8, 3.1 + parapet_m),
        box((1, 1, 3.0), (2.5, 3, 5.6)),
        box((6, 5, 3.0), (7.5, 6, 4.2)),
    ]
    found = sample([*room(), *roof])
    assert np.abs(found.floor_z).max() < 0.01


def test_a_closed_wall_is_not_passed_and_a_door_is():
    left, right = (0, 0, 4.9, 8), (5.1, 0, 10, 8)
    closed = sample([*room(), box((4.95, 0, -0.1), (5.05, 8, 3))], path((1.0, 1.0, 1.0)))
    assert inside(closed, *left).any()
    assert not inside(closed, *right).any()
    door = [
        box((4.95, 0, -0.1), (5.05, 3.2, 3)),
        box((4.95, 4.2, -0.1), (5.05, 8, 3)),
        box((4.95, 3.2, 2), (5.05, 4.2, 3)),
    ]
    opened = sample([*room(), *door], path((1.0, 1.0, 1.0)))
    assert inside(opened, *right).sum() >= 30


@pytest.mark.parametrize(("slope_deg", "passable"), [(10, True), (35, False)])
def test_a_slope_is_climbed_up_to_the_limit(slope_deg: float, passable: bool):
    rise = 6 * np.tan(np.radians(slope_deg))
    ramp = quad((5, 0, 0), (11, 0, rise), (11, 6, rise), (5, 6, 0))
    found = sample([floor(0, 0, 5, 6), ramp, floor(11, 0, 16, 6, rise)], path((1, 3, 0.6), (2, 3, 0.6)))
    # the first cells belong to the foot of the ramp: the floor before it makes them less steep
    assert inside(found, 6, 0, 10.5, 6).any() == passable
    assert inside(found, 11, 0, 16, 6).any() == passable
    on_ramp = inside(found, 6, 0, 10, 6)
    expected = (found.positions[on_ramp, 0] - 5) * np.tan(np.radians(slope_deg))
    np.testing.assert_allclose(found.floor_z[on_ramp], expected, atol=0.02)


def holed_floor(gap_m: float) -> list[Mesh]:
    return [floor(0, 0, 5, 6), floor(5 + gap_m, 0, 10, 6)]


@pytest.mark.parametrize(("gap_m", "bridged"), [(0.8, True), (2.5, False)])
def test_a_gap_in_the_floor_is_bridged_up_to_its_limit(gap_m: float, bridged: bool):
    found = sample(holed_floor(gap_m), path((1.0, 1.0, 1.0), (2.0, 1.0, 1.0)))
    assert inside(found, 5 + gap_m, 0, 10, 6).any() == bridged


STATIONS = path((1.5, 1.5, 1.5), (4.5, 5.0, 1.5), (1.5, 5.0, 1.5))
DRIVE = path(*((1.5 + 0.5 * step, 1.5, 1.5) for step in range(6)))


def terrace() -> list[Mesh]:
    """A floor, a platform 0.6 m above it, the roof of a car, a roof, and a room that nobody looked into."""
    platform = box((5, 0, -0.1), (12, 6, 0.6))
    car = box((2, 3, -0.1), (3.5, 5.5, 1.2))
    roof = box((0, 8, 2.8), (12, 14, 3.0))
    closed = [floor(14, 0, 20, 6), *walls(13.9, -0.1, 20.1, 6.1), floor(13.9, -0.1, 20.1, 6.1, 3.0)]
    return [floor(0, 0, 5, 6), platform, car, roof, *closed]


def test_a_platform_that_stations_saw_gets_viewpoints_though_no_step_reaches_it():
    found = sample(terrace(), STATIONS)
    platform = inside(found, 5.3, 0, 12, 6)
    assert platform.sum() >= 36
    np.testing.assert_allclose(found.floor_z[platform], 0.6, atol=0.01)
    assert np.abs(found.floor_z[~platform & ~inside(found, 5, 0, 5.3, 6)]).max() < 0.01  # on no car, no roof
    assert not inside(found, 13, -1, 21, 14).any()
    assert not (found.positions[:, 1] > 6).any()
    assert len(found.left_out) == 0


def test_a_run_that_drove_says_where_a_robot_can_be_and_what_is_left_out_is_counted():
    found = sample(terrace(), DRIVE)
    assert not inside(found, 5.3, 0, 20, 6).any()
    assert found.left_out is not None
    assert 36 <= len(found.left_out) <= 42
    assert ((found.left_out[:, 0] > 5) & (found.left_out[:, 0] < 12)).all()
    np.testing.assert_allclose(found.left_out[:, 2], 0.6, atol=0.01)


def test_without_a_trajectory_nothing_is_known_of_what_was_seen():
    assert sample(terrace()).left_out is None


def test_a_platform_with_a_station_on_it_has_viewpoints_as_far_as_it_reaches():
    found = sample(terrace(), path((1.5, 1.5, 1.5), (8.5, 3.0, 2.1)))
    assert inside(found, 0, 0, 5, 6).sum() >= 15
    assert inside(found, 5.3, 0, 12, 6).sum() >= 36


@pytest.mark.parametrize(
    ("step_m", "scans", "sparse"), [(0.5, 1, False), (1.8, 1, False), (2.5, 1, True), (8.0, 3, True)]
)
def test_sparse_poses_are_known_by_the_distance_between_neighbours(step_m: float, scans: int, sparse: bool):
    along = np.repeat(np.arange(12) * step_m, scans)  # several scans of one stop, a hand's breadth apart
    positions = np.column_stack([along, 0.1 * (np.arange(len(along)) % scans), np.full(len(along), 1.5)])
    order = np.random.default_rng(5).permutation(len(along))
    assert is_sparse(positions[order]) == sparse


@pytest.mark.parametrize("track", [STATIONS, DRIVE])
def test_small_tiles_see_what_one_tile_sees(monkeypatch: pytest.MonkeyPatch, track: NDArray[np.float64]):
    found = []
    for side_m in (4.0, 1000.0):
        monkeypatch.setattr(tiles, "SIDE_M", side_m)
        made = sample(terrace(), track)
        rows = np.concatenate([made.positions, made.left_out])
        found.append(rows[np.lexsort(rows.T)])
    np.testing.assert_array_equal(found[0], found[1])


def test_the_trajectory_is_floor_even_where_the_mesh_has_none():
    found = sample(holed_floor(2.5), path(*((x, 3.0, 0.8) for x in np.arange(1, 9.5, 0.5))))
    assert inside(found, 7.5, 0, 10, 6).any()
    bridge = inside(found, 5, 0, 7.5, 6)
    assert 2 <= bridge.sum() <= 3
    np.testing.assert_allclose(found.positions[bridge, 2], 0.8, atol=0.02)


def test_the_trajectory_gives_the_mount_height_unless_it_is_set():
    track = path((1, 1, 1.4), (2, 1, 1.5), (3, 1, 1.45))
    assert sample(room(), track).mount_height_m == pytest.approx(1.45, abs=1e-4)
    assert sample(room(), track, mount_height_m=0.9).mount_height_m == 0.9
    assert sample(room()).mount_height_m == MOUNT_M


def test_no_viewpoint_further_from_the_trajectory_than_asked():
    found = sample(room(), path((1, 4, 0.6), (2, 4, 0.6)), max_distance_to_trajectory_m=3.0)
    assert 10 < len(found) < 40
    assert found.positions[:, 0].max() < 5.1


def test_a_narrow_corridor_is_covered():
    # 0.8 m wide, off the raster of the blocks on purpose
    found = sample([floor(0, 0, 20, 0.8), *walls(0, 0, 20, 0.8), floor(0, 0, 20, 0.8, 3)])
    assert len(found) >= 19


def test_an_open_field_with_a_house_has_viewpoints_on_the_ground_alone():
    found = sample([floor(0, 0, 30, 30), box((10, 10, -0.1), (16, 18, 5))])
    assert not inside(found, 9.7, 9.7, 16.3, 18.3).any()
    assert np.abs(found.floor_z).max() < 1e-6
    assert len(found) > 700


def test_bumps_of_a_reconstructed_floor_do_not_stop_the_robot():
    x, y = np.meshgrid(np.arange(0, 10, 0.2), np.arange(0, 10, 0.2), indexing="ij")
    rng = np.random.default_rng(3)
    vertices = np.column_stack([x.ravel(), y.ravel(), rng.normal(0, 0.04, x.size)])
    n = len(x)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([corner, corner + n, corner + 1], 1), np.stack([corner + 1, corner + n, corner + n + 1], 1)]
    )
    found = sample([Mesh(vertices, triangles)])
    assert len(found) >= 95
    assert np.abs(found.floor_z).max() < 0.1


def test_a_map_without_floor_is_refused():
    with pytest.raises(BuildFailed, match="no floor"):
        sample(walls(0, 0, 0.05, 0.05))


@pytest.mark.parametrize("limit_m", [None, 5.0])
def test_a_trajectory_of_another_frame_is_refused(limit_m: float | None):
    with pytest.raises(BuildFailed, match="trajectory"):
        sample(room(), path((500, 0, 1), (501, 0, 1)), max_distance_to_trajectory_m=limit_m)


def test_one_pose_is_a_trajectory():
    assert len(sample(room(), path((5, 4, 1)))) == 80


def test_a_map_with_a_stray_corner_far_away_is_refused_before_memory_is_taken():
    with pytest.raises(BuildFailed, match="too large"):
        sample([*room(), floor(1e5, 1e5, 1e5 + 1, 1e5 + 1)])


def test_the_same_map_gives_the_same_bytes():
    first, second = sample(room()), sample(room())
    assert first.positions.tobytes() == second.positions.tobytes()


@pytest.mark.parametrize("with_track", [False, True])
def test_small_tiles_give_what_one_tile_gives(monkeypatch: pytest.MonkeyPatch, with_track: bool):
    rng = np.random.default_rng(4)
    parts = [
        floor(-20, -17, 21, 23),
        floor(-8, -8, 8, 8, 3.0),
        *walls(-8, -8, 8, 8),
        *walls(-20, -17, 21, 23),
    ]
    parts += [quad((8, -2, 3), (14, -2, 0), (14, 2, 0), (8, 2, 3)), floor(-6, 12, -3, 15, 0.4)]
    for x, y in rng.uniform(-19, 20, (60, 2)):
        parts.append(box((x, y, -0.1), (x + 0.9, y + 0.7, rng.uniform(0.1, 2.5))))
    track = path((-15, -12, 0.9), (-12.5, -12, 0.9), (10, 20, 0.9)) if with_track else None
    config = {"max_distance_to_trajectory_m": 9.0} if with_track else {}
    found = []
    for side_m in (4.0, 1000.0):
        monkeypatch.setattr(tiles, "SIDE_M", side_m)
        made = sample(parts, track, **config)
        rows = np.column_stack([made.positions, made.floor_z])
        found.append(rows[np.lexsort(rows.T)])
    assert len(found[0]) > 300
    np.testing.assert_array_equal(found[0], found[1])


def test_real_floor_plan_without_a_trajectory():
    import trimesh

    mesh = trimesh.load(recorded("worlds/hospital_aws_1floor.ply"))
    simulator = Simulator(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    found = sample_viewpoints(simulator, ViewpointConfig(), MOUNT_M)
    assert 1000 < len(found) < 1400
    stairs = np.abs(found.positions[:, 1] - 18.5) < 2.5
    assert np.abs(found.floor_z[~stairs]).max() < 0.6  # on no desk, cupboard, bed or ceiling
    assert np.mean(np.abs(found.floor_z[~stairs]) < 0.1) > 0.98
    assert found.floor_z[stairs].min() < -2.5  # down the stairs
    assert (simulator.distance(found.positions) > 0.25).all()
