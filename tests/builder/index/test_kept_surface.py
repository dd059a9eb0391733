"""Surface and free space of a rebuild: as from nothing where the map has changed, elsewhere as before."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import tests.reference.seen_free as oracle
from firstfix.catalog.manifest import Manifest
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.surface import Surface
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.errors import BuildCancelled
from firstfix.sensor import preset
from firstfix_builder.execution.stage_cache import StageResult
from firstfix_builder.index.carve import carve_chunks, cell_width_m, hash_of_run, merged
from firstfix_builder.index.changed_views import changed_views
from firstfix_builder.index.kept_free_space import carved_anew, cells_within, free_before
from firstfix_builder.index.kept_surface import NEWLY_SEEN_M, KeptSurface, distances, far_from
from firstfix_builder.index.views import views_in
from firstfix_builder.index.visible_points import map_surface
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.tiled_mesh import TiledMesh
from firstfix_builder.rebuild.base_version import BaseVersion, write_made_by
from firstfix_builder.simulation.changed_surface import ChangedSurface
from firstfix_builder.simulation.simulate import Simulator, upright
from tests.builder.box_scenes import box, floor

SENSOR = replace(preset("os0-64"), max_range_m=40.0)
VOXEL_M = 0.2


def yard(*boxes: tuple[tuple[float, ...], tuple[float, ...]]) -> Mesh:
    """A floor of 48 x 24 m in squares of 4 m, and boxes on it."""
    squares = [floor(x, y, x + 4, y + 4) for x in range(0, 48, 4) for y in range(0, 24, 4)]
    return Mesh.joined([*squares, *(box(low, high) for low, high in boxes)])


STAND = [((20, 14, 0), (23, 17, 2.5)), ((40, 4, 0), (43, 7, 2)), ((44, 14, 0), (46, 20, 3))]
BEFORE, AFTER = yard(((6, 6, 0), (8, 8, 2)), *STAND), yard(((6, 9, 0), (8, 11, 2)), *STAND)
POSITIONS = np.array([[x, y, 1.0] for x in np.arange(1.5, 47, 3.0) for y in (2.0, 12.5, 22.0)], np.float32)


@dataclass(frozen=True)
class Changed:
    """A change of the surface, and the folder of the mesh now."""

    change: ChangedSurface
    mesh: Path


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Changed:
    folder = tmp_path_factory.mktemp("yard")
    for name, mesh in (("before", BEFORE), ("after", AFTER)):
        (folder / name).mkdir()
        TiledMesh.of(mesh).save(folder / name)
    change = ChangedSurface.of(folder / "before", folder / "after", SENSOR.max_range_m)
    assert change is not None
    return Changed(change, folder / "after")


def from_nothing(mesh: Mesh, cloud: NDArray[np.float64] | None = None) -> Surface:
    simulator = Simulator(mesh.vertices, mesh.triangles)
    return map_surface(cloud, views_in(simulator, POSITIONS, SENSOR), VOXEL_M)


def rebuilt(
    changed: Changed, scratch: Path, before: Surface, cloud: NDArray[np.float64] | None = None
) -> Surface:
    kept = KeptSurface(before, changed.change, POSITIONS)
    return kept.renewed(cloud, changed_views(POSITIONS, kept, SENSOR, changed.mesh), VOXEL_M, scratch)


def alike(some: Surface, others: Surface) -> None:
    """Assert that normals agree where points do, but for a few at edges."""
    away_m, row = cKDTree(others.points).query(some.points)
    same = away_m < 0.02
    along = np.einsum("ij,ij->i", some.normals[same], others.normals[row[same]])
    assert (np.abs(along) > 0.9).mean() > 0.95
    told = (some.oriented[same] & others.oriented[row[same]]) & (np.abs(along) > 0.9)
    assert (along[told] > 0).mean() > 0.99


def test_the_surface_of_a_mesh_is_seen_anew_where_it_has_changed(changed: Changed, tmp_path: Path):
    before, exact = from_nothing(BEFORE), from_nothing(AFTER)
    found = rebuilt(changed, tmp_path, before)
    inside = changed.change.holds(exact.points)
    assert 500 < inside.sum() < len(exact) / 2
    assert (cKDTree(found.points).query(exact.points[inside])[0] < 0.01).mean() > 0.98
    assert cKDTree(found.points).query(exact.points)[0].max() < 2 * NEWLY_SEEN_M
    assert cKDTree(exact.points).query(found.points)[0].max() < 2 * VOXEL_M, "nothing that is gone is left"
    alike(found, exact)
    kept = int((~changed.change.holds(before.points)).sum())
    np.testing.assert_array_equal(found.points[:kept], before.points[~changed.change.holds(before.points)])


def test_surface_beside_what_has_gone_is_seen_to_its_edge(changed: Changed, tmp_path: Path):
    """As if the box had hidden a strip of the floor that is less than a metre wide."""
    whole = from_nothing(BEFORE)
    hidden = ((whole.points > (12.2, 6.0, -0.1)) & (whole.points < (13.0, 8.0, 0.1))).all(axis=1)
    assert hidden.sum() > 20
    found = rebuilt(changed, tmp_path, whole.at(~hidden))
    assert cKDTree(found.points).query(whole.points[hidden])[0].max() < 1.75 * VOXEL_M


def test_a_cloud_keeps_its_normals_but_around_what_has_changed(changed: Changed, tmp_path: Path):
    clouds = [from_nothing(mesh).points.astype(np.float64) for mesh in (BEFORE, AFTER)]
    outside = ~changed.change.holds(clouds[1])
    unchanged = clouds[0][~changed.change.holds(clouds[0])]
    cloud = np.concatenate([unchanged, clouds[1][~outside]])
    before, exact = from_nothing(BEFORE, clouds[0]), from_nothing(AFTER, cloud)
    found = rebuilt(changed, tmp_path, before, cloud)
    assert {point.tobytes() for point in found.points} == {point.tobytes() for point in exact.points}
    alike(found, exact)
    away = distances(found.points, exact.points[changed.change.holds(exact.points)], 4.0) > 4.0
    of_before = {point.tobytes(): normal for point, normal in zip(before.points, before.normals, strict=True)}
    assert away.sum() > 1000
    assert all(
        (of_before[point.tobytes()] == normal).all()
        for point, normal in zip(found.points[away], found.normals[away], strict=True)
    )


def test_what_has_not_changed_stays_to_the_last_bit(changed: Changed, tmp_path: Path):
    before = from_nothing(AFTER)
    nothing = ChangedSurface.of(changed.mesh, changed.mesh, SENSOR.max_range_m)
    assert nothing is not None
    found = rebuilt(Changed(nothing, changed.mesh), tmp_path, before)
    for name in ("points", "normals", "oriented"):
        np.testing.assert_array_equal(getattr(found, name), getattr(before, name))


def test_a_new_viewpoint_sees_all_around(changed: Changed, tmp_path: Path):
    west = POSITIONS[POSITIONS[:, 0] < 12]
    simulator = Simulator(AFTER.vertices, AFTER.triangles)
    before = map_surface(None, views_in(simulator, west, replace(SENSOR, max_range_m=12.0)), VOXEL_M)
    nothing = ChangedSurface.of(changed.mesh, changed.mesh, SENSOR.max_range_m)
    assert nothing is not None
    kept = KeptSurface(before, nothing, west)
    views = changed_views(POSITIONS, kept, SENSOR, changed.mesh)
    found = kept.renewed(None, views, VOXEL_M, tmp_path)
    assert cKDTree(found.points).query(from_nothing(AFTER).points)[0].max() < 2 * NEWLY_SEEN_M


def test_a_cancelled_build_ends_between_the_chunks_that_are_made_anew(changed: Changed):
    def cancelled() -> None:
        raise BuildCancelled("by its caller")

    kept = KeptSurface(from_nothing(BEFORE), changed.change, POSITIONS)
    with pytest.raises(BuildCancelled):
        list(changed_views(POSITIONS, kept, SENSOR, changed.mesh, cancelled))
    run = upright(np.array([[x, 12.0, 1.0] for x in np.arange(2, 40)]))
    registration, none = RegistrationConfig(map_voxel_m=VOXEL_M), np.zeros((0, 3), np.int32)
    before = SeenFree.of_bricks(none, np.zeros((0, 8, 2), np.int32), cell_width_m(registration))
    with pytest.raises(BuildCancelled):
        carved_anew(before, run, SENSOR, registration, changed.change, changed.mesh, cancelled)


def test_near_and_far_points_are_those_of_a_tree():
    rng = np.random.default_rng(2)
    points, places = (rng.uniform(-9, 9, (n, 3)).astype(np.float32) for n in (3000, 40))
    away_m = cKDTree(places).query(points)[0]
    np.testing.assert_allclose(distances(points, places, 1.5), np.where(away_m <= 1.5, away_m, np.inf))
    far = far_from(points, places, 1.0)
    assert (away_m[far] > 1.0).all()
    assert far[away_m > 2 * 3**0.5].all()
    assert np.isinf(distances(points, places[:0], 1.0)).all()
    assert far_from(points, places[:0], 1.0).all()


def test_free_space_is_carved_anew_where_the_surface_has_changed(changed: Changed):
    registration = RegistrationConfig(map_voxel_m=VOXEL_M)
    cell_m, trajectory = (
        cell_width_m(registration),
        upright(np.array([[x, 12.0, 1.0] for x in np.arange(2, 40)])),
    )
    chunks = carve_chunks(trajectory, SENSOR, registration)
    folders = {"before": changed.mesh.parent / "before", "after": changed.mesh}
    carved = {
        name: merged((chunk.run({"mesh": mesh}) for chunk in chunks), 2) for name, mesh in folders.items()
    }
    before = SeenFree.of_bricks(carved["before"]["brick"], carved["before"]["bits"], cell_m)
    found = carved_anew(before, trajectory, SENSOR, registration, changed.change, changed.mesh)
    found_cells = oracle.cells_in(found["brick"], found["bits"])
    then, now = (oracle.cells_in(carved[name]["brick"], carved[name]["bits"]) for name in ("before", "after"))
    low, high = np.ceil(changed.change.low / cell_m), np.floor(changed.change.high / cell_m) - 1

    def inside(cells: set[oracle.Cell]) -> set[oracle.Cell]:
        at = np.array(sorted(cells))
        held = np.zeros(len(at), bool)
        for first, last in zip(low, high, strict=True):
            held |= ((at >= first) & (at <= last)).all(axis=1)
        return {tuple(cell) for cell in at[held].tolist()}

    assert len(inside(now) ^ inside(then)) > 100
    assert inside(found_cells) == inside(now)
    assert then - inside(then) <= found_cells <= then | now
    assert len(now - found_cells) < 0.05 * len(now)


def test_free_space_is_kept_of_the_same_mapping_run_alone(tmp_path: Path):
    run = upright(np.array([[x, 12.0, 1.0] for x in np.arange(2, 40)]))
    SeenFree.of_bricks(np.zeros((1, 3), np.int32), np.ones((1, 8, 2), np.int32), 0.1).save(tmp_path)
    base = BaseVersion(tmp_path, cast("Manifest", None))
    write_made_by(tmp_path, hash_of_run(run))
    assert free_before(base, run) is not None
    for other in (run[:-4], np.concatenate([run, run[:1]]), run + np.eye(4, k=3)[None]):
        assert free_before(base, other) is None
    write_made_by(tmp_path, hash_of_run(None))
    assert free_before(base, run) is None


def test_bricks_are_those_that_the_tables_were_made_of():
    rng = np.random.default_rng(1)
    brick = np.unique(rng.integers(-30, 30, (400, 3)), axis=0).astype(np.int32)
    bits = rng.integers(1, 1 << 30, (len(brick), 8, 2)).astype(np.int32)
    found = SeenFree.of_bricks(brick, bits, 0.1).bricks
    assert dict(zip(map(bytes, found[0]), map(bytes, found[1]), strict=True)) == dict(
        zip(map(bytes, brick), map(bytes, bits), strict=True)
    )


@pytest.mark.parametrize("high_m", [(1.3, 2.6, 2.0), (2000.0, 2000.0, 0.5)])
def test_the_cells_within_a_box_are_those_that_lie_wholly_in_it(high_m: tuple[float, ...]):
    """A triangle may be as large as the map: so may its box be."""
    brick = np.stack(np.meshgrid(*3 * [np.arange(-1, 3)]), axis=-1).reshape(-1, 3).astype(np.int32)
    low, high = np.float32([[-0.35, -0.5, 0.1]]), np.float32([high_m])
    change = ChangedSurface(StageResult("", Path(), ""), low, high, None, None)
    found = oracle.cells_in(brick, cells_within(brick, change, 0.25))
    corner = np.stack(np.meshgrid(*3 * [np.arange(-8, 24)]), axis=-1).reshape(-1, 3)
    inside = ((corner * 0.25 >= low) & ((corner + 1) * 0.25 <= high)).all(axis=1)
    assert found == {tuple(cell) for cell in corner[inside].tolist()}


def test_no_cell_is_within_no_change(changed: Changed):
    nothing = ChangedSurface(StageResult("", changed.mesh, ""), *np.zeros((2, 0, 3), np.float32), None, None)
    assert not cells_within(np.zeros((3, 3), np.int32), nothing, 0.1).any()
    assert len(cells_within(np.zeros((0, 3), np.int32), changed.change, 0.1)) == 0
