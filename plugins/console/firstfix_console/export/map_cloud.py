"""The points of a version's cloud, as many as a viewer takes at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.catalog.viewer_cloud import POINT, STEPS
from firstfix.errors import CorruptVersion

AT_ONCE = 500_000  # points of one request
SEED = 0

ReadBytes = Callable[[int, int], bytes]
BRIGHTEST = 255


@dataclass(frozen=True)
class MapCloud:
    """Points of a map, and what is drawn beside them, in the map's frame.

    Attributes:
        points: (n, 3) float32 metres.
        brightness: (n,) uint8, from 0 to 255 between ``intensity_ends``; None: it has no intensity.
        intensity_ends: what 0 and 255 stand for, in the unit of the map's source.
        templates: (k, 3) float32, positions of the templates.
        trajectory: (p, 3) float32, positions of the mapping run in its order; may be empty.
    """

    points: NDArray[np.float32]
    brightness: NDArray[np.uint8] | None
    intensity_ends: tuple[float, float]
    templates: NDArray[np.float32]
    trajectory: NDArray[np.float32]

    def intensity(self) -> NDArray[np.float32] | None:
        """(n,) intensity of the points in the unit of the map's source; None: it has none."""
        if self.brightness is None:
            return None
        low, high = self.intensity_ends
        return (low + self.brightness * ((high - low) / BRIGHTEST)).astype(np.float32)


def read_map_cloud(
    index: Mapping[str, Any], read: ReadBytes, read_intensity: ReadBytes, most_points: int
) -> MapCloud:
    """Read the coarse levels of a cloud, and of the first level that is too much an even part, by chance.

    Args:
        index: content of ``cloud.json``.
        read: returns the packed points from a first one on, so many.
        read_intensity: their intensity, a byte each; called only where the index tells of one.

    Raises:
        CorruptVersion: the index or the points contradict the format.
    """
    try:
        nodes: list[Sequence[int]] = [[int(v) for v in node] for node in index["nodes"]]
        marks = {name: [int(v) for v in run] for name, run in index["marks"].items()}
        low, edge_m = np.array(index["low_m"], np.float64), float(index["edge_m"])
        levels = [node[0] for node in nodes]
        ends = index.get("intensity")
        low_end, high_end = (0.0, 1.0) if ends is None else map(float, ends)
        found = [
            _points_of(node, low, edge_m, read, None if ends is None else read_intensity, share)
            for node, share in zip(nodes, _shares(nodes, most_points), strict=True)
            if share > 0
        ]
        if (
            levels != sorted(levels)
            or low.shape != (3,)
            or not np.isfinite([*low, edge_m, low_end, high_end]).all()
        ):
            raise ValueError("its nodes are not in order, or its root is no cube")
        beside = {
            name: _points_of([0, 0, 0, 0, *marks.get(name, (0, 0))], low, edge_m, read, None, 1.0)[0]
            for name in ("templates", "trajectory")
        }
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CorruptVersion(f"the cloud of the version cannot be read: {error!r}") from None
    points = np.concatenate([np.empty((0, 3), np.float32), *(at for at, _ in found)])
    bright = None if ends is None else np.concatenate([np.empty(0, np.uint8), *(one for _, one in found)])
    return MapCloud(points, bright, (low_end, high_end), beside["templates"], beside["trajectory"])


def _shares(nodes: Sequence[Sequence[int]], most_points: int) -> Iterator[float]:
    """The share of each node's points that is taken: 1 for the coarse levels, 0 for the fine ones."""
    of_level: dict[int, int] = {}
    for level, *_, count in nodes:
        of_level[level] = of_level.get(level, 0) + count
    left, share = most_points, {}
    for level in sorted(of_level):
        share[level] = min(1.0, left / max(of_level[level], 1))
        left = max(0, left - of_level[level])
    return (share[node[0]] for node in nodes)


def _points_of(
    node: Sequence[int],
    low: NDArray[np.float64],
    edge_m: float,
    read: ReadBytes,
    read_intensity: ReadBytes | None,
    share: float,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """(n, 3) points and their (n,) brightness, which is empty without ``read_intensity``."""
    level, x, y, z, first, count = node
    edge = edge_m / 2**level
    corner = low + np.array([x, y, z]) * edge
    parts, brightness = [np.empty((0, 3), np.float32)], [np.empty(0, np.uint8)]
    for begin in range(first, first + count, AT_ONCE):
        wanted = min(AT_ONCE, first + count - begin)
        packed = np.frombuffer(read(begin, wanted), POINT)
        if len(packed) != wanted:
            raise ValueError(f"{len(packed)} of {wanted} points came")
        bright = np.empty(0, np.uint8)
        if read_intensity is not None:
            bright = np.frombuffer(read_intensity(begin, wanted), np.uint8)
            if len(bright) != wanted:
                raise ValueError(f"the intensity of {len(bright)} of {wanted} points came")
        if share < 1:
            chosen = np.random.default_rng([SEED, begin]).permutation(len(packed))[: int(share * len(packed))]
            chosen.sort()
            packed, bright = packed[chosen], bright[chosen] if len(bright) else bright
        parts.append((corner + packed["at"] * (edge / STEPS)).astype(np.float32))
        brightness.append(bright)
    return np.concatenate(parts), np.concatenate(brightness)
