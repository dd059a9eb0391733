"""Search with FAISS: one index, or in a large map one for each group of tiles, with merged answers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import faiss
import numpy as np
from numpy.typing import NDArray

from ...config import SearchConfig
from .faiss_indexes import empty_index, probes_for
from .key_codes import KeyCodes
from .key_lists import KeyLists
from .tile_shards import TileShards

FILE = "keys.faiss"  # of a search with one index
SHARDS_FILE = "keys_shards.safetensors"
# IO_FLAG_MMAP would map inverted lists only, with a lock for each, at a third of the speed
_FLAGS = faiss.IO_FLAG_MMAP_IFC | faiss.IO_FLAG_READ_ONLY | faiss.IO_FLAG_SKIP_PRECOMPUTE_TABLE
_Found = tuple[NDArray[np.float32], NDArray[np.int64]]  # distances and rows


class FaissSearch:
    """Index of the config's ``engine``, whole or in shards.

    All shards are trained as one. If there are lists, their centres are the same in every shard: the nearest
    lists are found once and searched in every shard.
    """

    def __init__(self, indexes: Sequence[faiss.Index], shards: TileShards | None = None) -> None:
        """Search over indexes.

        Args:
            indexes: one for each shard.
            shards: rows of each index; None: there is one index, of all rows.
        """
        self._indexes, self._shards = indexes, shards
        self._inverted = isinstance(indexes[0], faiss.IndexIVF)
        self._count = sum(index.ntotal for index in indexes)

    @classmethod
    def build(
        cls, keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
    ) -> FaissSearch:
        """Build the indexes over (n, d) keys at (n, 3) positions."""
        empty = empty_index(config.engine, keys)
        shards = None
        if position_m is not None and len(keys) > config.shard_keys:
            shards = TileShards.of(position_m, config.shard_keys)
        if shards is None or len(shards) == 1:
            empty.add(keys)
            return cls([empty])
        indexes = []
        for rows in np.split(shards.row, shards.begin[1:-1]):
            indexes.append(faiss.clone_index(empty))
            indexes[-1].add(np.ascontiguousarray(keys[rows]))
        return cls(indexes, shards)

    def __len__(self) -> int:
        return self._count

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """Rows of at most ``count`` keys near a (d,) key, nearest first."""
        # Queries run in parallel, each in its own thread. With a team of threads for each, they would wait:
        # 12 ms instead of 0.1 on busy cores. The setting holds for the calling thread.
        faiss.omp_set_num_threads(1)
        if self._shards is None:
            index, few = self._indexes[0], min(count, len(self))
            how = faiss.SearchParametersIVF(nprobe=probes_for(index, few)) if self._inverted else None
            _, rows = index.search(key[None], few, params=how)
            found: NDArray[np.int64] = rows[0]
            return found[found >= 0]
        found = _merged(self._of_every_shard(key[None], count), count)[0]
        return found[found >= 0]

    def codes(self) -> KeyCodes | None:
        """Codes of all keys, for the compiled cascade; None: they are in shards or in lists."""
        return KeyCodes.of(self._indexes[0]) if self._shards is None else None

    def key_lists(self) -> KeyLists | None:
        """All keys, for many searches at once; None: they are not in lists."""
        if not self._inverted:
            return None
        if self._shards is None:
            return KeyLists.of(self._indexes, [np.arange(len(self))])
        return KeyLists.of(
            self._indexes, [self._rows_of(number, self._shards) for number in range(len(self._indexes))]
        )

    def search_among(
        self, key: NDArray[np.float32], rows: NDArray[np.integer], count: int
    ) -> NDArray[np.int64]:
        """The ``count`` nearest of (m,) ascending rows, or all of them."""
        faiss.omp_set_num_threads(1)
        if self._shards is None:
            _, found = _among(self._indexes[0], key, rows, count)
            return found
        parts = []
        for shard, places in self._shards.split(rows):
            distance, found = _among(self._indexes[shard], key, places, count)
            parts.append((distance, self._rows_of(shard, self._shards)[found].astype(np.int64)))
        return _merged(parts, count)

    def save(self, directory: Path) -> None:
        """Write the indexes, and the table of shards if there are several."""
        if self._shards is None:
            faiss.write_index(self._indexes[0], str(directory / FILE))
            return
        self._shards.save(directory / SHARDS_FILE)
        for number, index in enumerate(self._indexes):
            faiss.write_index(index, str(directory / _shard_file(number)))

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> FaissSearch:
        """Read the indexes, memory-mapped: processes that load them share their pages.

        Raises:
            RuntimeError, ValueError, OSError: a file is missing or damaged, or belongs to another search.
        """
        if not (directory / SHARDS_FILE).exists():
            return cls([faiss.read_index(str(directory / FILE), _FLAGS)])
        shards = TileShards.load(directory / SHARDS_FILE)
        files = [directory / _shard_file(number) for number in range(len(shards))]
        indexes = [faiss.read_index(str(path), _FLAGS) for path in files]
        for path, index, size in zip(files, indexes, np.diff(shards.begin), strict=True):
            if index.ntotal != size or type(index) is not type(indexes[0]):
                raise ValueError(f"{path.name} belongs to another search")
        return cls(indexes, shards)

    def _of_every_shard(self, keys: NDArray[np.float32], count: int) -> Iterable[_Found]:
        first, near = self._indexes[0], None
        if self._inverted:
            near = first.quantizer.search(keys, probes_for(first, min(count, len(self))))
        for number, index in enumerate(self._indexes):
            few = min(count, index.ntotal)
            distance, place = index.search(keys, few) if near is None else _in_lists(index, keys, few, *near)
            distance[place < 0] = np.inf  # the lists hold fewer keys
            if self._shards is not None:
                place = np.where(place < 0, -1, self._rows_of(number, self._shards)[place].astype(np.int64))
            yield distance, place

    def _rows_of(self, shard: int, shards: TileShards) -> NDArray[np.int32]:
        return shards.row[shards.begin[shard] : shards.begin[shard + 1]]


def _in_lists(
    index: faiss.IndexIVF,
    keys: NDArray[np.float32],
    count: int,
    list_distance: NDArray[np.float32],
    lists: NDArray[np.int64],
) -> _Found:
    """Searches (n, m) given lists. Returns (n, count) distances and places.

    FAISS' own wrapper accepts only the index's own number of lists.
    """
    keys = np.ascontiguousarray(keys, np.float32)
    distance, place = np.empty((len(keys), count), np.float32), np.empty((len(keys), count), np.int64)
    how = faiss.SearchParametersIVF(nprobe=lists.shape[1])
    pointers = [faiss.swig_ptr(array) for array in (lists, list_distance, distance, place)]
    index.search_preassigned_c(len(keys), faiss.swig_ptr(keys), count, *pointers, False, how)
    return distance, place


def _among(index: faiss.Index, key: NDArray[np.float32], rows: NDArray[np.integer], count: int) -> _Found:
    """Search the given rows only, in all inverted lists. Returns the nearest first."""
    if not len(rows):  # a search for nothing is an error
        return np.empty(0, np.float32), np.empty(0, np.int64)
    chosen = np.zeros(index.ntotal, np.bool_)
    chosen[rows] = True
    selector = faiss.IDSelectorBitmap(np.packbits(chosen, bitorder="little"))
    few = min(count, len(rows))
    if isinstance(index, faiss.IndexIVF):
        every = faiss.SearchParametersIVF(sel=selector, nprobe=index.nlist)
        distance, found = index.search(key[None], few, params=every)
    else:
        every = faiss.SearchParameters(sel=selector)
        distance, found = index.search(key[None], few, params=every)
    there = found[0] >= 0
    return distance[0][there], found[0][there]


def _merged(parts: Iterable[_Found], count: int) -> NDArray[np.int64]:
    """Rows of the nearest of all parts, nearest first; of equal distances the lower row first.

    Args:
        parts: distances and rows of each, (k,) of one key, or (n, k) of n keys.
    """
    distances, rows = zip(*parts, strict=True)
    distance, row = np.concatenate(distances, axis=-1), np.concatenate(rows, axis=-1)
    nearest = np.lexsort((row, distance))[..., :count]
    return np.take_along_axis(row, nearest, axis=-1)


def _shard_file(number: int) -> str:
    return f"keys_{number:03}.faiss"
