"""Patches: the points that a fleet's confirmed changes add to a cloud and remove from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import CorruptVersion
from firstfix_builder.mesh.intensity import Intensity
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.sources.patch.confirm import confirmed_changes
from firstfix_builder.sources.patch.map_patch import MapPatch, patch_of
from firstfix_builder.sources.patch.observation import seen_by
from firstfix_builder.sources.write_level_map import write_cloud
from firstfix_builder.stage_results import LevelMap
from tests.builder.sources.patch.fleet import CHANGED, MAPPED, MOVED, RACK, SIZE_M, Fleet, days
from tests.changed_hall import surface_points


def on(boxes: Boxes, points: np.ndarray, within_m: float) -> np.ndarray:
    """(n,) whether points are in one of the boxes or so near to it."""
    beyond = np.abs(points[:, None] - boxes.centre_m) - boxes.half_m
    return np.linalg.norm(np.maximum(beyond, 0), axis=2).min(axis=1) <= within_m


def mapped_cloud() -> np.ndarray:
    vertices, triangles = Boxes.joined(MAPPED.things).mesh()
    things, _ = surface_points(vertices[triangles], 0.1)
    floor = np.stack(np.meshgrid(np.arange(0, SIZE_M[0], 0.1), np.arange(0, SIZE_M[1], 0.1)), axis=-1)
    return np.concatenate([things, np.column_stack([floor.reshape(-1, 2), np.zeros(floor.size // 2)])])


def test_what_has_left_goes_and_what_has_come_is_added():
    fleet = Fleet()
    observations = [
        *fleet.drive(MAPPED, ("ann", "bob"), days(0)),
        *fleet.drive(CHANGED, ("ann", "bob"), days(1, 2, 3, 4)),
    ]
    seen, _ = seen_by(MAPPED.index, observations)
    cloud = mapped_cloud()
    patch = patch_of(confirmed_changes(seen), seen, MAPPED.index, cloud, robots=2, voxel_m=0.1)
    assert on(RACK, patch.removed, 0.15).mean() > 0.97, "little of the floor around it"
    laid = patch.lay(cloud)
    sides = (cloud[:, 2] > 0.3) & (cloud[:, 2] < 1.9)  # nobody sees its top, and its foot is on the floor
    before = on(RACK, cloud[sides], 0.02).sum()
    sides = (laid[:, 2] > 0.3) & (laid[:, 2] < 1.9)
    assert on(RACK, laid[sides], 0.02).sum() < 0.1 * before
    below = np.abs(patch.added[:, 2]) < 0.15  # the floor where the rack stood was never mapped
    assert on(MOVED, patch.added, 0.15)[~below].mean() > 0.97
    assert (on(MOVED, patch.added, 0.15) & ~below).sum() > 200
    assert abs(len(cloud) + len(patch.added) - len(patch.removed) - len(laid)) < 0.01 * len(patch.removed)


def test_a_later_patch_is_laid_over_an_earlier_one():
    rng = np.random.default_rng(1)
    cloud = rng.uniform(0, 10, (200, 3))
    added = rng.uniform(20, 30, (30, 3)).astype(np.float32)
    first = MapPatch(added, cloud[:50].astype(np.float32))
    second = MapPatch(
        np.full((1, 3), 40, np.float32), np.concatenate([added[:10], cloud[50:60]]).astype("f4")
    )
    once = first.then(second).lay(cloud)
    assert len(once) == 200 - 60 + 30 - 10 + 1
    twice = second.lay(first.lay(cloud))
    order = [np.lexsort(points.T) for points in (once, twice)]
    assert np.allclose(once[order[0]], twice[order[1]], atol=1e-6)
    assert np.array_equal(MapPatch().lay(cloud), cloud)


def test_points_that_stay_keep_their_intensity_and_added_ones_have_the_middle(tmp_path: Path):
    cloud = np.random.default_rng(1).uniform(0, 10, (200, 3))
    bright = Intensity(np.round(25 * cloud[:, 0]).astype(np.uint8), 3.0, 90.0)
    patch = MapPatch(np.full((4, 3), 20, np.float32), cloud[50:70].astype(np.float32))
    laid, shaded = patch.lay(cloud), patch.shade(cloud, bright)
    assert len(shaded.values) == len(laid) == 184
    np.testing.assert_array_equal(shaded.values[:180], np.round(25 * laid[:180, 0]))
    assert set(shaded.values[180:].tolist()) == {round(float(np.median(bright.values)))}
    assert (shaded.low, shaded.high) == (3.0, 90.0)
    write_cloud(laid, shaded, tmp_path)
    read = LevelMap("", tmp_path, "")
    told = read.intensity
    assert told is not None
    of_map = read.points[:, 0] < 11
    np.testing.assert_array_equal(told.values[of_map], np.round(25 * read.points[of_map, 0]))


def test_a_patch_is_read_as_it_was_written(tmp_path: Path):
    patch = MapPatch(np.ones((3, 3), np.float32), np.zeros((2, 3), np.float32))
    patch.save(tmp_path / "patch.npz")
    read = MapPatch.load(tmp_path / "patch.npz")
    assert np.array_equal(read.added, patch.added)
    assert np.array_equal(read.removed, patch.removed)
    for damaged in (np.full((3, 3), np.nan, np.float32), np.ones((3, 2), np.float32), np.ones((3, 3))):
        np.savez(tmp_path / "patch.npz", added=damaged, removed=patch.removed)
        with pytest.raises(CorruptVersion):
            MapPatch.load(tmp_path / "patch.npz")
    (tmp_path / "patch.npz").write_bytes(b"no zip")
    with pytest.raises(CorruptVersion):
        MapPatch.load(tmp_path / "patch.npz")
