"""The paper's second search engine (III.C, Table V): hash tables, and a KD tree in every bucket."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...config import LshConfig, SearchConfig
from .keys_file import load_keys, nearest_of, save_keys


class LshKdTree:
    """A key's hash in a table is the signs of its projections on the table's directions.

    The first table's directions are the principal components of the keys (PCA-BP), the others' are
    random (RBP). A query looks into its own bucket of every table, and into those where the signs of
    its smallest projections are the other way: a neighbour across a hyperplane is found there.
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
        return cls(keys, config.lsh)

    def __len__(self) -> int:
        return len(self._keys)

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """At most ``count`` of the keys in the buckets: others, it may be, than the nearest of all.

        Where the buckets hold too few keys, more of them are looked into.
        """
        centred, count = key - self._mean, min(count, len(self._keys))
        probes = self._probes
        while len(rows := self._in_buckets(centred, count, probes)) < count:
            probes *= 2
        return rows

    def search_among(
        self, key: NDArray[np.float32], rows: NDArray[np.integer], count: int
    ) -> NDArray[np.int64]:
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

    def save(self, directory: Path) -> None:
        save_keys(self._keys, directory)

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> LshKdTree:
        """Makes the tables anew: the same every time."""
        return cls(load_keys(directory), config.lsh)


class _Bucket:
    """The keys of one hash, and their KD tree."""

    def __init__(self, keys: NDArray[np.float32], rows: NDArray[np.int64]) -> None:
        self._rows, self._tree = rows, cKDTree(keys[rows])

    def nearest(self, key: NDArray[np.float32], count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        distance, inside = self._tree.query(key, k=range(1, min(count, len(self._rows)) + 1))
        return distance, self._rows[inside]


class _Table:
    """(b, d) directions, and the buckets of the (n, d) keys."""

    def __init__(self, keys: NDArray[np.float32], directions: NDArray[np.float32]) -> None:
        self._directions = directions
        hashes = _pack(keys @ directions.T > 0)
        order = np.argsort(hashes, kind="stable")
        found, start = np.unique(hashes[order], return_index=True)
        groups = np.split(order, start[1:])
        self._buckets = {int(h): _Bucket(keys, rows) for h, rows in zip(found, groups, strict=True)}

    def buckets(self, key: NDArray[np.float32], probes: int) -> Iterator[_Bucket]:
        """The (d,) key's own bucket and those nearest to it, at most ``probes`` that hold anything."""
        projection = self._directions @ key
        own = int(_pack(projection[None] > 0)[0])
        for flipped in _nearest_flips(projection**2, probes):
            bucket = self._buckets.get(own ^ flipped)
            if bucket is not None:
                yield bucket


def _pack(bits: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(n, b) to (n,) integers, the first bit the lowest."""
    return bits @ (1 << np.arange(bits.shape[1], dtype=np.int64))


def _nearest_flips(cost: NDArray[np.float32], count: int) -> list[int]:
    """The ``count`` sets of bits, as masks, whose flipping costs least: none at all comes first.

    Bit by bit, from the cheapest on: a set that is not among the first ``count`` of some bits is not
    among them with further bits either.
    """
    sets = [(0.0, 0)]
    for bit in np.argsort(cost, kind="stable").tolist():
        flipped = [(total + float(cost[bit]), mask | 1 << bit) for total, mask in sets]
        sets = sorted(sets + flipped)[:count]
    return [mask for _, mask in sets]


def _directions(centred: NDArray[np.float32], config: LshConfig) -> Iterator[NDArray[np.float32]]:
    """(b, d) for every table: principal components, then random ones, all orthonormal."""
    dimensions = centred.shape[1]
    bits = min(config.bits, dimensions)
    covariance = centred.T.astype(np.float64) @ centred
    yield np.linalg.eigh(covariance)[1][:, ::-1][:, :bits].T.astype(np.float32)
    rng = np.random.default_rng(config.seed)
    for _ in range(config.random_tables):
        turn, _ = np.linalg.qr(rng.normal(size=(dimensions, bits)))
        yield turn.T.astype(np.float32)
