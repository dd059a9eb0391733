"""The visible points of a place with known walls, and the sides they are seen from."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from firstfix.engine.made_of import Arrays
from firstfix.sensor import preset
from firstfix_builder.index import seen_voxels as seen_voxels_module
from firstfix_builder.index import visible_points as visible_points_module
from firstfix_builder.index.seen_voxels import SeenBlocks, mean_points
from firstfix_builder.index.views import NEAR_M, STEP_M, view_chunks, views_in
from firstfix_builder.index.visible_points import map_surface
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator
from tests.builder.box_scenes import box

SENSOR = preset("os0-64")


def boxes(*ends: tuple[tuple[float, ...], tuple[float, ...]]) -> Simulator:
    mesh = Mesh.joined([box(low, high) for low, high in ends])
    return Simulator(mesh.vertices, mesh.triangles)


def two_rooms() -> Simulator:
    """A hall of 8 by 4 by 3 m with a wall across, 0.2 m thick."""
    return boxes(((0, 0, 0), (8, 4, 3)), ((3.9, 0, 0), (4.1, 4, 3)))


VIEWPOINTS = np.array([[1.5, 2, 1], [2.5, 2, 1], [5.5, 2, 1], [6.5, 2, 1]])


def seen_points(simulator: Simulator, viewpoints: np.ndarray, folder: Path) -> np.ndarray:
    """(m, 6) of all blocks."""
    seen = SeenBlocks(folder, STEP_M)
    for part in views_in(simulator, viewpoints, SENSOR):
        seen.add(part["voxels"])
    return np.concatenate([mean_points(seen.voxels(block), STEP_M) for block in sorted(seen.blocks)])


def test_points_lie_on_what_is_seen_and_know_from_where(tmp_path):
    seen = seen_points(two_rooms(), VIEWPOINTS, tmp_path)
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
    surface = map_surface(None, views_in(two_rooms(), VIEWPOINTS, preset("vlp-16")), 0.12)
    x, y, z = surface.points.T
    for level in (0, 3):
        here = np.abs(z - level) < 0.02
        assert cKDTree(np.column_stack([x, y])[here]).query(VIEWPOINTS[:, :2])[0].max() < 0.15


def test_the_surface_of_a_mesh_faces_those_who_see_it():
    surface = map_surface(None, views_in(two_rooms(), VIEWPOINTS, SENSOR), 0.12)
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
    surface = map_surface(np.concatenate([west, unseen]), views_in(two_rooms(), VIEWPOINTS, SENSOR), 0.05)
    on_wall = surface.points[:, 0] < 10
    assert surface.oriented[on_wall].mean() > 0.95
    assert np.median(surface.normals[on_wall, 0]) < -0.95
    assert not surface.oriented[~on_wall].any()
    assert (~on_wall).sum() > 200


def test_block_by_block_the_same_is_seen(monkeypatch):
    whole = map_surface(None, views_in(two_rooms(), VIEWPOINTS, SENSOR), 0.12)
    for module in (visible_points_module, seen_voxels_module):
        monkeypatch.setattr(module, "BLOCK_M", 2.4)
    parted = map_surface(None, views_in(two_rooms(), VIEWPOINTS, SENSOR), 0.12)
    away_m, row = cKDTree(whole.points).query(parted.points)
    assert abs(len(parted) - len(whole)) < 0.1 * len(whole)
    assert np.percentile(away_m, 99) < 0.1
    alike = np.einsum("ij,ij->i", parted.normals, whole.normals[row])
    assert (np.abs(alike) > 0.9).mean() > 0.95  # the others stand in corners
    assert (alike[parted.oriented & whole.oriented[row]] > 0).mean() > 0.97


def two_storeys() -> tuple[Simulator, np.ndarray]:
    """A building of 24 by 12 m, both of whose storeys look alike, and its viewpoints column by column."""
    simulator = boxes(((0, 0, 0), (24, 12, 2.8)), ((0, 0, 3), (24, 12, 5.8)))
    columns = [[x, y, z] for x in np.arange(1, 24) for y in np.arange(1, 12) for z in (1.0, 4.0)]
    return simulator, np.array(columns)


def test_no_storey_is_passed_over(tmp_path):
    """Each storey is looked at as well as the other, although not all viewpoints are used."""
    simulator, viewpoints = two_storeys()
    used = np.concatenate([chunk.viewpoints for chunk in view_chunks(viewpoints, SENSOR)])
    assert len(used) < len(viewpoints) / 2
    assert 0.4 < (used[:, 2] < 2).mean() < 0.6
    seen = seen_points(simulator, viewpoints, tmp_path)
    assert 0.45 < (seen[:, 2] < 2.9).mean() < 0.55


def test_what_is_far_from_all_viewpoints_is_seen_too(tmp_path):
    hall = boxes(((0, 0, 0), (40, 6, 3)))
    near_one_end = np.array([[x, y, 1.0] for x in range(1, 9) for y in range(1, 6)], float)
    seen = seen_points(hall, near_one_end, tmp_path)
    end = seen[np.abs(seen[:, 0] - 40) < 0.02]
    assert NEAR_M < 40 - 8
    assert len(end) > 60, "the wall at the other end"
    assert (end[:, 3] < -0.9).all()


def test_viewpoints_elsewhere_change_no_chunk():
    rng = np.random.default_rng(5)
    west, east = (
        rng.uniform([0, 0, 1], [60, 60, 1], (4000, 3)),
        rng.uniform([70, 0, 1], [130, 60, 1], (4000, 3)),
    )
    more = rng.uniform([70, 0, 1], [130, 60, 1], (500, 3))
    before = view_chunks(np.concatenate([west, east]), SENSOR)
    after = view_chunks(np.concatenate([west, more, east])[::-1], SENSOR)
    same = [chunk for chunk in after if chunk in before]
    here = [chunk for chunk in before if (chunk.tile[0] + 1) * chunk.reach.tile_m <= 64]
    assert here
    assert all(chunk in same for chunk in here)
    assert len(same) < len(after)


def test_the_order_of_what_is_seen_does_not_matter(tmp_path):
    parts = [part["voxels"] for part in views_in(*two_storeys(), SENSOR)]
    found = []
    for name, order in (("there", parts), ("back", parts[::-1])):
        (tmp_path / name).mkdir()
        seen = SeenBlocks(tmp_path / name, STEP_M)
        for part in order:
            seen.add(part)
        found.append(
            np.concatenate([mean_points(seen.voxels(block), STEP_M) for block in sorted(seen.blocks)])
        )
    assert len(parts) > 2
    assert found[0].tobytes() == found[1].tobytes()


def test_only_blocks_near_a_change_get_their_normals_anew(monkeypatch: pytest.MonkeyPatch):
    for module in (visible_points_module, seen_voxels_module):
        monkeypatch.setattr(module, "BLOCK_M", 4.0)
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform([0, 0], [40, 4], (8000, 2)), np.zeros(8000)])
    changed = np.where((floor[:, :1] > 37) & (floor[:, 1:2] < 2), floor + [0, 0, 0.4], floor)
    kept: dict[bytes, Arrays] = {}
    made: list[int] = []

    def made_of(work: str, content: Sequence[np.ndarray], make: Callable[[], Arrays]) -> Arrays:
        key = b"".join([work.encode(), *(one.tobytes() for one in content)])
        if key not in kept:
            kept[key] = make()
            made.append(1)
        return kept[key]

    map_surface(floor, [], 0.2, made_of=made_of)
    assert len(made) == 10
    made.clear()
    upon = map_surface(changed, [], 0.2, made_of=made_of)
    assert 1 <= len(made) <= 2
    fresh = map_surface(changed, [], 0.2)
    for name in ("points", "normals", "oriented"):
        assert getattr(upon, name).tobytes() == getattr(fresh, name).tobytes()
