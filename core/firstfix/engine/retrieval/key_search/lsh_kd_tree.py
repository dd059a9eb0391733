"""Hash tables with a KD tree in every bucket, the paper's second search engine (III.C, Table V)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...config import LshConfig, SearchConfig
from .keys_file import load_keys, nearest_of, save_keys


class LshKdTree:
    """Hash tables: a key's hash is the signs of its projections on a table's directions.

    The directions of the first table are the principal components of the keys (PCA-BP), those of the others
    are random (RBP). A query searches its own bucket of every table, and buckets that differ in the signs of
    its smallest projections: they hold neighbours across a hyperplane.
    """

    def __init__(self, keys: NDArray[np.float32], config: LshConfig) -> None:
        self._keys = keys
        self._probes = config.probes
        self._mean = keys.mean(axis=0, dtype=np.float64).astype(np.float32)
        centred = keys - self._mean
        self._tables = [_Table(centred, directions) for directions in _directions(centred, config)]

    @classmethod
    def build(
        cls, keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
    ) -> LshKdTree:
        """Build the tables over (n, d) keys."""
        return cls(keys, config.lsh)

    def __len__(self) -> int:
        return len(self._keys)

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """Rows of the ``count`` nearest keys in the searched buckets, which need not be the nearest of all.

        If the buckets hold too few keys, more buckets are searched.
        """
        centred, count = key - self._mean, min(count, len(self._keys))
        probes = self._probes
        while len(rows := self._in_buckets(centred, count, probes)) < count:
            probes *= 2
        return rows

    def search_among(
        self, key: NDArray[np.float32], rows: NDArray[np.integer], count: int
    ) -> NDArray[np.int64]:
        """The ``count`` nearest of (m,) ascending rows, or all of them."""
        return nearest_of(self._keys, key, rows, count)

    def _in_buckets(self, centred: NDArray[np.float32], count: int, probes: int) -> NDArray[np.int64]:
        found = [
            bucket.nearest(centred, count)
            for table in self._tables
            for bucket in table.buckets(centred, probes)
        ]
        if not found:
            return np.empty(0, np.int64)
        rows = np.concatenate([rows for _, rows in found])
        distance = np.concatenate([distance for distance, _ in found])
        rows, first = np.unique(rows, return_index=True)
        return rows[np.argsort(distance[first], kind="stable")[:count]]

    def codes(self) -> None:
        """None: the compiled cascade reads other keys."""

    def save(self, directory: Path) -> None:
        """Write the keys, without the tables."""
        save_keys(self._keys, directory)

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> LshKdTree:
        """Build the tables again from the keys: the same tables every time."""
        return cls(load_keys(directory), config.lsh)


class _Bucket:
    """Keys of one hash, with their KD tree."""

    def __init__(self, keys: NDArray[np.float32], rows: NDArray[np.int64]) -> None:
        from scipy.spatial import cKDTree  # imported late: the default engine does without it

        self._rows, self._tree = rows, cKDTree(keys[rows])

    def nearest(self, key: NDArray[np.float32], count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        distance, inside = self._tree.query(key, k=range(1, min(count, len(self._rows)) + 1))
        return distance, self._rows[inside]


class _Table:
    """Directions (b, d) of one table, and the buckets of (n, d) keys."""

    def __init__(self, keys: NDArray[np.float32], directions: NDArray[np.float32]) -> None:
        self._directions = directions
        hashes = _pack(keys @ directions.T > 0)
        order = np.argsort(hashes, kind="stable")
        found, start = np.unique(hashes[order], return_index=True)
        groups = np.split(order, start[1:])
        self._buckets = {int(h): _Bucket(keys, rows) for h, rows in zip(found, groups, strict=True)}

    def buckets(self, key: NDArray[np.float32], probes: int) -> Iterator[_Bucket]:
        """Yield the bucket of a (d,) key and those nearest to it: at most ``probes``, without empty ones."""
        projection = self._directions @ key
        own = int(_pack(projection[None] > 0)[0])
        for flipped in _nearest_flips(projection**2, probes):
            bucket = self._buckets.get(own ^ flipped)
            if bucket is not None:
                yield bucket


def _pack(bits: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Packs (n, b) bits into (n,) integers, the first bit the lowest."""
    return bits @ (1 << np.arange(bits.shape[1], dtype=np.int64))


def _nearest_flips(cost: NDArray[np.float32], count: int) -> list[int]:
    """Masks of the ``count`` sets of bits that cost least to flip, cheapest first; the empty set comes first.

    Bits are added one by one, cheapest first. A set that is not among the cheapest ``count`` then cannot
    become one of them with more bits.
    """
    sets = [(0.0, 0)]
    for bit in np.argsort(cost, kind="stable").tolist():
        flipped = [(total + float(cost[bit]), mask | 1 << bit) for total, mask in sets]
        sets = sorted(sets + flipped)[:count]
    return [mask for _, mask in sets]


def _directions(centred: NDArray[np.float32], config: LshConfig) -> Iterator[NDArray[np.float32]]:
    """Yield orthonormal directions (b, d) for every table: principal components first, then random ones."""
    dimensions = centred.shape[1]
    bits = min(config.bits, dimensions)
    covariance = centred.T.astype(np.float64) @ centred
    yield np.linalg.eigh(covariance)[1][:, ::-1][:, :bits].T.astype(np.float32)
    rng = np.random.default_rng(config.seed)
    for _ in range(config.random_tables):
        turn, _ = np.linalg.qr(rng.normal(size=(dimensions, bits)))
        yield turn.T.astype(np.float32)
