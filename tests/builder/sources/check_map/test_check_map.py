"""What the checks find in wrong maps, and that they find nothing in right ones."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.errors import UnfitMap
from firstfix.transform import rotation_z
from firstfix_builder.sources.check_map.check_map import check_map, refuse
from firstfix_builder.sources.check_map.doubled_walls import check_doubled_walls
from firstfix_builder.sources.read_map.map_data import MapData, local_origin, subtract_origin
from firstfix_builder.sources.read_map.map_file import read_map_file
from firstfix_builder.sources.read_map.map_limits import MapLimits
from tests.every_case import every_case
from tests.needs import of_recordings
from tests.recorded_data import HALL
from tests.small_world import SmallWorld

UTM = np.array([450_000.0, 5_200_000.0, 300.0])


def cloud(world: SmallWorld, points: int = 150_000) -> np.ndarray:
    import trimesh

    mesh = trimesh.Trimesh(world.vertices, world.triangles, process=False)
    return np.asarray(trimesh.sample.sample_surface(mesh, points, seed=1)[0])


def doubled(points: np.ndarray) -> np.ndarray:
    """With half of it again, turned by 1 degree and shifted by 0.5 m: a loop that was not closed."""
    half = points[points[:, 0] > np.median(points[:, 0])]
    turn, centre = np.radians(1.0), half.mean(axis=0)
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return np.concatenate([points, (half - centre) @ R.T + centre + [0.4, 0.3, 0.0]])


def poses_at(positions: np.ndarray) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    return poses


def codes(points: np.ndarray, poses: np.ndarray | None = None) -> list[str]:
    data = MapData(points=points, trajectory=poses, trajectory_source="given")
    data = subtract_origin(data, local_origin(data))
    return [one.code for one in check_map(data, data.trajectory)]


@pytest.fixture(scope="module")
def right(small_world: SmallWorld) -> np.ndarray:
    return cloud(small_world)


def on_the_way(right: np.ndarray) -> np.ndarray:
    return poses_at(np.column_stack([np.linspace(-6, 6, 40), np.zeros(40), np.full(40, 0.8)]))


@every_case(
    ("change", "poses", "expected"),
    [
        (lambda right: right, on_the_way, []),
        (lambda right: right + UTM, None, []),
        (lambda right: 1000 * right, None, ["map_unit"]),
        (lambda right: 100 * right, None, ["map_unit"]),
        (lambda right: right / 100, None, ["map_unit"]),
        (lambda right: right / 1000, None, ["map_unit"]),
        (lambda right: (right + UTM).astype(np.float32).astype(float), None, ["map_float32"]),
        (lambda right: right[:103], None, ["map_few_points"]),
        (lambda right: 5 * right[:300], None, ["map_too_coarse"]),
        (lambda right: right[np.abs(right[:, 2]) < 0.12], None, ["map_flat"]),
        (lambda right: right[:, [1, 2, 0]], None, ["map_not_level"]),
        (doubled, None, ["map_doubled_walls"]),
        (
            lambda right: right,
            lambda right: poses_at(right[rows_by_chance(len(right), len(right) // 100)]),
            ["trajectory_is_cloud"],
        ),
        (lambda right: right - [500, 0, 0], on_the_way, ["trajectory_elsewhere"]),
    ],
    ids=[
        *("right", "UTM", "millimetres", "centimetres", "/100", "/1000", "float32", "103 points"),
        *("coarse", "floor", "y up", "doubled", "a cloud as trajectory", "a trajectory elsewhere"),
    ],
)
def test_a_map_has_the_findings(right: np.ndarray, change, poses, expected: list[str]):
    assert codes(change(right), None if poses is None else poses(right)) == expected


def test_how_a_map_is_turned_does_not_matter_for_doubled_walls(right: np.ndarray):
    R, away_m, twice = rotation_z(np.radians(37.0)), np.array([3.0, -7.0, 0.0]), doubled(right)
    at_first = check_doubled_walls(twice, np.zeros(3))
    turned = check_doubled_walls(twice @ R.T + away_m, np.zeros(3))
    assert at_first is not None
    assert turned is not None
    assert turned.numbers == pytest.approx(at_first.numbers, rel=1e-6)
    np.testing.assert_allclose((np.array(turned.places) - away_m) @ R, at_first.places, atol=0.02)


def test_a_way_that_is_flat_along_y_tells_that_y_points_up_where_walls_hide_it(right: np.ndarray):
    is_floor = np.abs(right[:, 2]) < 0.05
    walled = np.concatenate(
        [right[is_floor][: is_floor.sum() // 3], right[~is_floor]]
    )  # more wall than floor
    turn = np.linspace(0, 2 * np.pi, 40)
    way = np.column_stack([5 * np.cos(turn), 3.5 * np.sin(turn), np.full(40, 0.8)])
    yup = [1, 2, 0]
    assert codes(walled, poses_at(way)) == []
    assert codes(walled[:, yup]) == [], "without a trajectory it may be right"
    assert codes(walled[:, yup], poses_at(way[:, yup])) == ["map_not_level"]


def test_a_wrong_unit_is_refused_with_the_scale_to_give(right: np.ndarray):
    for factor, scale in ((1000, "0.001"), (100, "0.01"), (0.01, "100"), (0.001, "1000")):
        with pytest.raises(UnfitMap, match=f"--scale {scale} "):
            refuse(check_map(MapData(points=factor * right)))


def test_a_mesh_in_millimetres_is_refused(small_world: SmallWorld):
    mesh = MapData(vertices=1000.0 * small_world.vertices * [10, 10, 1.5], triangles=small_world.triangles)
    assert [one.code for one in check_map(mesh)] == ["map_unit"]
    assert check_map(MapData(vertices=small_world.vertices, triangles=small_world.triangles)) == []


def test_a_map_that_needs_too_much_memory_is_refused_with_the_figures(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("firstfix_builder.sources.read_map.map_limits.memory_bytes", lambda: 4 << 30)
    limits = MapLimits(300_000_000, 16_000_000_000)
    limits.check("PCD", 10_000_000, 16)
    with pytest.raises(UnfitMap, match=r"100,000,000 points need about 18\.\d GB of memory.* 4\.3 GB"):
        limits.check("PCD", 100_000_000, 16)


def test_a_real_hall_has_no_findings_and_its_double_has():
    if not HALL.available:
        pytest.skip(of_recordings("hilti_hall_indoor"))
    points = read_map_file(HALL.map_path).points
    assert points is not None
    assert codes(points) == []
    assert codes(doubled(points)) == ["map_doubled_walls"]
