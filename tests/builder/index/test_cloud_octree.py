"""The octree that viewers draw: every point is in one node, nodes are even, and positions are exact."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_INTENSITY, CLOUD_POINTS
from firstfix.catalog.viewer_cloud import NO_NORMAL, POINT
from firstfix.engine.made_of import Arrays
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.index import cloud_octree
from firstfix_builder.index.cloud_octree import CELLS, LEAF_POINTS, CloudOctree, octahedral
from firstfix_builder.mesh.intensity import Intensity


def hall(count: int, seed: int = 1) -> np.ndarray:
    """Points on the floor and the walls of a hall of 60 x 30 x 8 m, far from the frame's zero."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([0, 0, 0], [60, 30, 8], (count, 3))
    side = rng.integers(0, 3, count)
    points[side == 0, 2] = 0
    points[side == 1, 1] = 30
    points[side == 2, 0] = 0
    return points + [4e5, 5e6, 100]


def read(directory: Path) -> tuple[dict, np.ndarray]:
    index = json.loads((directory / "cloud.json").read_text())
    return index, np.fromfile(directory / "cloud.bin", POINT)


def positions(index: dict, packed: np.ndarray, node: list[int]) -> np.ndarray:
    level, *cell, first, count = node
    edge_m = index["edge_m"] / 2**level
    return np.array(index["low_m"]) + (np.array(cell) + packed[first : first + count]["at"] / 65535) * edge_m


def test_every_point_is_in_one_node_at_its_place(tmp_path):
    points = hall(150_000)
    CloudOctree.of(points).save(tmp_path)
    index, packed = read(tmp_path)
    assert index["points"] == len(packed) == len(points)
    found = np.concatenate([positions(index, packed, node) for node in index["nodes"]])
    # the coarsest step is that of the root: 60 m / 65535
    order, expected = (np.lexsort(np.round(each, 2).T) for each in (found, points))
    assert np.abs(np.sort(found, axis=0) - np.sort(points, axis=0)).max() < 1e-3
    assert np.median(np.linalg.norm(found[order] - points[expected], axis=1)) < 1e-3


def test_a_node_is_even_and_its_children_lie_within_it(tmp_path):
    CloudOctree.of(hall(150_000)).save(tmp_path)
    index, packed = read(tmp_path)
    cells = {(level, *cell) for level, *cell, _, _ in index["nodes"]}
    assert index["nodes"][0][:4] == [0, 0, 0, 0]
    for level, x, y, z, _, count in index["nodes"]:
        assert count <= LEAF_POINTS or (level, x, y, z) == (0, 0, 0, 0) or count <= CELLS**2 * 6
        assert level == 0 or (level - 1, x // 2, y // 2, z // 2) in cells
    root = positions(index, packed, index["nodes"][0])
    taken = np.floor((root - index["low_m"]) / (index["edge_m"] / CELLS) + 1e-9)
    assert len(np.unique(taken, axis=0)) >= 0.99 * len(root)


def test_the_root_alone_shows_the_whole_map(tmp_path):
    points = hall(150_000)
    CloudOctree.of(points).save(tmp_path)
    index, packed = read(tmp_path)
    root = positions(index, packed, index["nodes"][0])
    np.testing.assert_allclose(root.min(axis=0), points.min(axis=0), atol=0.5)
    np.testing.assert_allclose(root.max(axis=0), points.max(axis=0), atol=0.5)
    assert 0.02 < len(root) / len(points) < 0.7


def test_the_order_of_the_points_does_not_choose_who_is_shown_first(tmp_path):
    """A file that begins with one wall must not fill the root with it."""
    points = hall(120_000)
    points = points[np.argsort(points[:, 0])]
    CloudOctree.of(points).save(tmp_path)
    index, packed = read(tmp_path)
    left = np.mean(positions(index, packed, index["nodes"][0])[:, 0] < 4e5 + 30)
    assert left == pytest.approx(np.mean(points[:, 0] < 4e5 + 30), abs=0.15)


def test_no_node_is_empty_where_few_points_lie_far_from_the_others(tmp_path):
    """A viewer asks for nodes by their first point, which an empty one would share with the next."""
    rng = np.random.default_rng(6)
    points = np.concatenate([hall(60_000), rng.uniform(0, 600, (200, 3)) + [4e5, 5e6, 100]])
    CloudOctree.of(points).save(tmp_path)
    index, packed = read(tmp_path)
    assert min(count for *_, count in index["nodes"]) > 0
    assert index["points"] == len(packed) == len(points)


def test_many_points_at_one_place_end_at_the_last_level(tmp_path):
    points = np.repeat([[1.0, 2.0, 3.0]], LEAF_POINTS + 100, axis=0)
    CloudOctree.of(points).save(tmp_path)
    assert read(tmp_path)[0]["points"] == LEAF_POINTS + 100


def test_a_single_point_is_a_cloud(tmp_path):
    CloudOctree.of(np.array([[1.0, 2.0, 3.0]])).save(tmp_path)
    index, packed = read(tmp_path)
    np.testing.assert_allclose(positions(index, packed, index["nodes"][0]), [[1, 2, 3]], atol=2e-5)


def test_marks_stand_where_they_are_even_outside_the_cloud(tmp_path):
    marks = {
        "templates": np.array([[4e5 - 50, 5e6, 100.0], [4e5, 5e6 + 80, 101.5]]),
        "trajectory": np.zeros((0, 3)),
    }
    CloudOctree.of(hall(5000), marks=marks).save(tmp_path)
    index, packed = read(tmp_path)
    assert index["points"] == 5000
    assert index["marks"]["trajectory"][1] == 0
    found = positions(index, packed, [0, 0, 0, 0, *index["marks"]["templates"]])
    np.testing.assert_allclose(found, marks["templates"], atol=2e-3)


def test_a_larger_cloud_is_thinned_evenly():
    points = hall(50_000)
    points = points[np.argsort(points[:, 0])]
    tree = CloudOctree.of(points, most_points=10_000)
    assert len(tree.offsets_m) == 10_000
    for end in (15, 30, 45):
        kept = np.mean(tree.offsets_m[:, 0] + tree.low_m[0] < 4e5 + end)
        assert kept == pytest.approx(np.mean(points[:, 0] < 4e5 + end), abs=0.02)


def test_a_cloud_of_many_parts_gives_the_bytes_of_one(tmp_path, monkeypatch):
    """Each part's points are copied alone: how many there are is no part of the result."""
    points, normals = hall(60_000), np.random.default_rng(2).integers(-127, 128, (60_000, 2), np.int8)
    T = make_transform(rotation_z(0.3), [10.0, -5.0, 2.0])
    for name, at_once in (("one", 1 << 20), ("many", 7_001)):
        monkeypatch.setattr(cloud_octree, "AT_ONCE", at_once)
        (tmp_path / name).mkdir()
        CloudOctree.of(points, normals, T_map_points=T).save(tmp_path / name)
    for file in (CLOUD_INDEX, CLOUD_POINTS):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "many" / file).read_bytes()


def test_of_a_change_only_the_cubes_around_it_are_made_again(tmp_path: Path):
    """Other cubes are taken from an earlier build. The bytes are those of a cloud drawn from nothing."""
    points = np.concatenate([hall(60_000, seed) + [60 * seed, 0, 0] for seed in range(1, 5)])
    normals = np.random.default_rng(3).integers(-127, 128, (len(points), 2), np.int8)
    intensity = Intensity(np.arange(len(points)).astype(np.uint8), 0.0, 1.0)
    changed = np.concatenate([points[1000:1100] + [0.1, 0, 0], points])
    there = [np.concatenate([one[1000:1100], one]) for one in (normals, intensity.values)]
    kept: dict[bytes, Arrays] = {}
    made: list[str] = []

    def made_of(work: str, content: Sequence[np.ndarray], make: Callable[[], Arrays]) -> Arrays:
        key = b"".join(one.tobytes() for one in content)
        if key not in kept:
            made.append(work)
            kept[key] = make()
        return kept[key]

    for name in ("before", "after", "fresh"):
        (tmp_path / name).mkdir()
    CloudOctree.of(points, normals, intensity=intensity).save(tmp_path / "before", made_of)
    cubes = len(made)
    assert cubes >= 8
    made.clear()
    tree = CloudOctree.of(changed, there[0], intensity=replace(intensity, values=there[1]))
    tree.save(tmp_path / "after", made_of)
    assert 1 <= len(made) <= cubes / 2
    tree.save(tmp_path / "fresh")
    for file in (CLOUD_INDEX, CLOUD_POINTS, CLOUD_INTENSITY):
        assert (tmp_path / "after" / file).read_bytes() == (tmp_path / "fresh" / file).read_bytes()


def test_the_intensity_is_beside_the_points_in_their_order(tmp_path):
    points = hall(60_000)
    values = np.floor(4 * (points[:, 0] - 4e5)).astype(np.uint8)
    CloudOctree.of(points, intensity=Intensity(values, 3.0, 77.5)).save(tmp_path)
    index, packed = read(tmp_path)
    assert index["intensity"] == [3.0, 77.5]
    found = np.fromfile(tmp_path / CLOUD_INTENSITY, np.uint8)
    assert len(found) == index["points"] == 60_000
    at = np.concatenate([positions(index, packed, node) for node in index["nodes"]])
    away = np.abs(4 * (at[:, 0] - 4e5) - found - 0.5)
    assert away.max() < 0.52
    (tmp_path / "bare").mkdir()
    CloudOctree.of(points).save(tmp_path / "bare")
    assert not (tmp_path / "bare" / CLOUD_INTENSITY).exists()
    assert read(tmp_path / "bare")[0]["intensity"] is None
    assert (tmp_path / "bare" / CLOUD_POINTS).read_bytes() == (tmp_path / CLOUD_POINTS).read_bytes()


def test_points_and_normals_stay_together_and_come_into_the_maps_frame(tmp_path):
    points = hall(60_000)
    normals = np.stack([np.floor(points[:, 0] - 4e5), np.floor(points[:, 1] - 5e6)], axis=1).astype(np.int8)
    np.save(tmp_path / "points.npy", points)
    T = make_transform(np.eye(3), [-4e5, -5e6, 0.0])
    CloudOctree.of(np.load(tmp_path / "points.npy", mmap_mode="r"), normals, T_map_points=T).save(tmp_path)
    index, packed = read(tmp_path)
    found = np.concatenate([positions(index, packed, node) for node in index["nodes"]])
    np.testing.assert_allclose(
        index["bounds_m"], [(points @ np.eye(3) + T[:3, 3]).min(axis=0), (points + T[:3, 3]).max(axis=0)]
    )
    inside = np.abs(found[:, :2] - np.round(found[:, :2])).min(axis=1) > 2e-3  # not on a border of the marks
    np.testing.assert_array_equal(packed["normal"][inside], np.floor(found[inside, :2]))


def test_normals_come_back_within_two_degrees():
    normals = np.random.default_rng(4).normal(size=(5000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    x, y = (octahedral(normals) / 127.0).T
    z = 1 - np.abs(x) - np.abs(y)
    fold = np.clip(-z, 0, None)
    back = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=1)
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    assert np.rad2deg(np.arccos(np.clip((back * normals).sum(axis=1), -1, 1))).max() < 2
    assert (octahedral(np.zeros((2, 3))) == NO_NORMAL).all()
