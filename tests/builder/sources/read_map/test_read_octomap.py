"""OctoMap's files. OctoMap itself (pyoctomap 1.2.2) writes such files and has the same occupied leaves."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from firstfix_builder.sources.read_map import read_map
from tests.every_case import every_case

LEVELS, RESOLUTION_M = 16, 0.1
MIDDLE = 1 << LEVELS - 1
RNG = np.random.default_rng(6)
WALLS = np.unique(RNG.integers([-40, -30, 0], [40, 30, 2], (700, 3)), axis=0)
SIZE = "# Octomap OcTree{} file\n# (feel free to add comments)\n#\nid {}\nsize 1\nres {}\ndata\n"


def tree_of(voxels: np.ndarray, level: int = 0) -> list:
    """Children by their numbers: None, an occupied leaf (True), or such a list."""
    if level == LEVELS:
        return []
    bit = voxels >> (LEVELS - 1 - level) & 1
    child = bit[:, 0] | bit[:, 1] << 1 | bit[:, 2] << 2
    return [tree_of(voxels[child == i], level + 1) if (child == i).any() else None for i in range(8)]


def bt(node: list) -> bytes:
    """A node of children; lists of nothing are occupied leaves."""
    kinds = [0 if child is None else (2 if child == [] else 3) for child in node]
    word = sum(kind << 2 * i for i, kind in enumerate(kinds))
    return struct.pack("<H", word) + b"".join(bt(child) for child in node if child)


def ot(node: list, colour: bytes = b"") -> bytes:
    children = sum(1 << i for i, child in enumerate(node) if child is not None)
    head = struct.pack("<f", 2.0) + colour + bytes([children])
    return head + b"".join(ot(child, colour) for child in node if child is not None)


def write(
    folder: Path, name: str, body: bytes, tree: str = "OcTree", resolution: object = RESOLUTION_M
) -> Path:
    path = folder / name
    head = SIZE.format(" binary" if name.endswith(".bt") else "", tree, resolution)
    path.write_bytes(head.encode() + body)
    return path


TREE = tree_of(WALLS + MIDDLE)


def pruned(levels: int) -> list:
    """A tree with one leaf above the last level, at the origin."""
    node: list = []
    for level in range(levels, 0, -1):
        child = 7 if level == 1 else 0
        node = [node if i == child else None for i in range(8)]
    return node


@every_case(
    ("name", "body", "tree"),
    [
        ("a.bt", bt(TREE), "OcTree"),
        ("a.ot", ot(TREE), "OcTree"),
        ("colour.ot", ot(TREE, b"\1\2\3"), "ColorOcTree"),
        ("colour.bt", bt(TREE), "ColorOcTree"),
    ],
)
def test_occupied_voxels_are_points(tmp_path, name, body, tree):
    data = read_map(write(tmp_path, name, body, tree))
    found = data.points[np.lexsort(data.points.T)]
    np.testing.assert_allclose(found, ((WALLS + 0.5) * RESOLUTION_M)[np.lexsort(WALLS.T)])
    assert data.read.form == f"OctoMap's {tree}, voxels of 0.1 m"


def test_a_larger_leaf_is_its_surface(tmp_path):
    """A leaf of level 13 has an edge of 8 voxels."""
    data = read_map(write(tmp_path, "a.bt", bt(pruned(13))))
    cells = np.floor(data.points / RESOLUTION_M).astype(int)
    assert len(np.unique(cells, axis=0)) == len(cells) == 8**3 - 6**3
    assert (cells.min(axis=0) == 0).all()
    assert (cells.max(axis=0) == 7).all()


def test_free_leaves_of_log_odds_are_no_points(tmp_path):
    node = struct.pack("<fB", 0.0, 0b11) + struct.pack("<fB", -0.4, 0) + struct.pack("<fB", 3.5, 0)
    for level in range(LEVELS - 1):
        node = struct.pack("<fB", 3.5, 1 << (7 if level == LEVELS - 2 else 0)) + node
    (point,) = read_map(write(tmp_path, "a.ot", node)).points
    np.testing.assert_allclose(point, [0.15, 0.05, 0.05])


@every_case(
    ("name", "body", "tree", "resolution", "error", "reason"),
    [
        ("a.bt", bt(TREE)[:-1], "OcTree", 0.1, MalformedData, "cut off after"),
        ("a.ot", ot(TREE)[:-5], "OcTree", 0.1, MalformedData, "cut off after"),
        ("a.bt", b"\xff" * 4000, "OcTree", 0.1, MalformedData, "more than 16 levels"),
        ("a.ot", ot(TREE)[:5] * 4000, "OcTree", 0.1, MalformedData, "more than 16 levels"),
        ("a.bt", b"\2\0", "OcTree", 0.1, TooLarge, "points, the limit is"),
        ("a.bt", b"\1\0", "OcTree", 0.1, MalformedData, "no voxel is occupied"),
        ("a.bt", bt(TREE), "OcTree", "nan", MalformedData, "a resolution of 'nan'"),
        ("a.bt", bt(TREE), "OcTree", -1, MalformedData, "a resolution of '-1'"),
        ("a.ot", ot(TREE), "CountingOcTree", 0.1, UnsupportedFormat, "of the kind 'CountingOcTree'"),
        ("a.ot", b"", "OcTree", 0.1, MalformedData, "no voxel|cut off"),
    ],
)
def test_a_damaged_tree_is_named(tmp_path, name, body, tree, resolution, error, reason):
    with pytest.raises(error, match=rf"^a\...: OctoMap.*({reason})"):
        read_map(write(tmp_path, name, body, tree, resolution))


def test_no_tree_at_all(tmp_path):
    (tmp_path / "a.bt").write_bytes(b"# Octomap OcTree binary file\nid OcTree\n")
    with pytest.raises(InputError, match="no line 'data'"):
        read_map(tmp_path / "a.bt")
