"""OctoMap's trees: the middles of all occupied voxels (.bt: occupied or free; .ot: log-odds).

A head of lines, of which the last is ``data``, then the nodes, depth first. A node of .bt has two bits for
each child: 1 free, 2 occupied, 3 a node with children. One of .ot has its log-odds, a colour in a
ColorOcTree, and a byte of which children are there. Child i lies in x by bit 0 of i, in y by bit 1, in z by
bit 2.

OctoMap 1.10, ``OcTreeBaseImpl::readNodesRecurs`` and ``OccupancyOcTreeBase::readBinaryNode``. They go as deep
as a file says; here a tree has 16 levels.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData, UnsupportedFormat

from .map_data import MapData
from .map_limits import LIMITS
from .what_was_read import WhatWasRead

LEVELS = 16
_MAX_HEAD_BYTES = 65_536
_OCCUPIED, _INNER = 2, 3
_DEEPEST = 1 << (3 * LEVELS)  # path of the first voxel: a 1, and three bits for each level
_BYTES_BEHIND_LOG_ODDS = {"OcTree": 0, "ColorOcTree": 3}
# Children of a node of .bt with children of their own, the last first: they are read from a stack.
_INNER_CHILDREN: dict[int, tuple[int, ...]] = {}


@dataclass(frozen=True)
class _Head:
    is_binary: bool
    tree: str
    resolution_m: float
    start: int


def read_octomap(path: Path) -> MapData:
    """Raises MalformedData, TooLarge, or UnsupportedFormat for a tree of another kind."""
    raw = path.read_bytes()
    head = _head(raw)
    paths = _of_binary(raw, head.start) if head.is_binary else _of_full(raw, head)
    if not len(paths):
        raise MalformedData("OctoMap: no voxel is occupied")
    read = WhatWasRead(form=f"OctoMap's {head.tree}, voxels of {head.resolution_m:g} m", unit="metre")
    return MapData(points=_middles(paths) * head.resolution_m, read=read)


def _head(raw: bytes) -> _Head:
    text = raw[:_MAX_HEAD_BYTES].partition(b"\ndata\n")
    lines = text[0].decode("latin-1").splitlines()
    if not text[1] or not lines[0].startswith("# Octomap OcTree"):
        raise MalformedData("OctoMap: the file does not begin with '# Octomap OcTree', or has no line 'data'")
    told = dict(line.split(maxsplit=1) for line in lines if len(line.split()) > 1 and line[0] != "#")
    is_binary, tree = lines[0].startswith("# Octomap OcTree binary file"), told.get("id", "").strip()
    if tree not in _BYTES_BEHIND_LOG_ODDS:
        raise UnsupportedFormat(
            f"OctoMap: a tree of the kind {tree[:40]!r}: there are {', '.join(_BYTES_BEHIND_LOG_ODDS)}"
        )
    try:
        resolution_m = float(told.get("res", ""))
    except ValueError:
        resolution_m = 0.0
    if not 1e-4 < resolution_m < 1e3:
        raise MalformedData(f"OctoMap: a resolution of {told.get('res', 'nothing')[:40]!r}")
    return _Head(is_binary, tree, resolution_m, len(text[0]) + len(text[1]))


def _of_binary(raw: bytes, at: int) -> NDArray[np.int64]:
    """(n,) paths of the occupied leaves of a .bt file."""
    inner, words = array("q"), array("H")
    stack = [1]
    try:
        while stack:
            path = stack.pop()
            word = raw[at] | raw[at + 1] << 8
            at += 2
            inner.append(path)
            words.append(word)
            children = _INNER_CHILDREN.get(word)
            if children is None:
                children = tuple(i for i in range(7, -1, -1) if word >> 2 * i & 3 == _INNER)
                _INNER_CHILDREN[word] = children
            if children:
                path <<= 3
                if path >= _DEEPEST:
                    raise MalformedData(f"OctoMap: the tree has more than {LEVELS} levels")
                stack += [path | i for i in children]
    except IndexError:
        raise MalformedData(f"OctoMap: the file is cut off after {len(inner)} nodes") from None
    paths, kinds = np.frombuffer(inner, np.int64), np.frombuffer(words, np.uint16)
    return np.concatenate([paths[kinds >> 2 * i & 3 == _OCCUPIED] << 3 | i for i in range(8)])


def _of_full(raw: bytes, head: _Head) -> NDArray[np.int64]:
    """(n,) paths of the occupied leaves of an .ot file."""
    behind = _BYTES_BEHIND_LOG_ODDS[head.tree]
    record = np.dtype([("log_odds", "<f4"), ("behind", "u1", behind), ("children", "u1")])
    count = (len(raw) - head.start) // record.itemsize
    nodes = np.frombuffer(raw, record, count, head.start)
    children_of = nodes["children"].tobytes()
    paths = array("q")
    stack = [1] if count else []
    try:
        while stack:
            path = stack.pop()
            children = children_of[len(paths)]
            paths.append(path)
            if children:
                path <<= 3
                if path >= _DEEPEST << 3:
                    raise MalformedData(f"OctoMap: the tree has more than {LEVELS} levels")
                stack += [path | i for i in range(7, -1, -1) if children >> i & 1]
    except IndexError:
        raise MalformedData(f"OctoMap: the file is cut off after {len(paths)} nodes") from None
    read = nodes[: len(paths)]
    with np.errstate(invalid="ignore"):
        occupied = (read["children"] == 0) & (read["log_odds"] >= 0)
    return np.frombuffer(paths, np.int64)[occupied]


def _middles(paths: NDArray[np.int64]) -> NDArray[np.float64]:
    """(m, 3) middles of voxels, in voxels; of larger leaves of those at their surface."""
    level = (np.frexp(paths.astype(np.float64))[1] - 1) // 3
    edge: NDArray[np.int64] = 1 << (LEVELS - level)
    _check_size(edge)
    corner = np.zeros((len(paths), 3), np.int64)
    for bit in range(LEVELS):
        digit = paths >> 3 * bit & 7
        digit[bit >= level] = 0
        for axis in range(3):
            corner[:, axis] |= (digit >> axis & 1) << bit
    corner *= edge[:, None]
    parts = []
    for size in sorted(set(edge.tolist())):
        offsets = _shell(size)
        parts.append((corner[edge == size][:, None] + offsets).reshape(-1, 3))
    return np.concatenate(parts) + 0.5 - (1 << LEVELS - 1)


def _shell(size: int) -> NDArray[np.int64]:
    """(k, 3) places of the voxels at the surface of a cube."""
    across, up = np.indices((size, size)).reshape(2, -1)
    faces = [
        np.roll(np.column_stack([np.full(len(up), side), across, up]), axis, axis=1)
        for side in (0, size - 1)
        for axis in range(3)
    ]
    return np.unique(np.concatenate(faces), axis=0)


def _check_size(edges: NDArray[np.int64]) -> None:
    """Check what cubes of these edges have at their surfaces, before memory is taken for it."""
    sizes, counts = np.unique(edges, return_counts=True)
    total = sum(
        (size**3 - max(size - 2, 0) ** 3) * count
        for size, count in zip(sizes.tolist(), counts.tolist(), strict=True)
    )
    LIMITS.check("OctoMap", total, 3 * 8)
