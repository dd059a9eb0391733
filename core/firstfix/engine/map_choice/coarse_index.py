"""Coarse index over the templates of all maps: which maps a scan resembles most.

Templates are found by key and compared by the descriptor (docs/method.md sections 3 and 4), as in one map.
Keys of several maps can be compared where the descriptors have the same parameters, so there is a group for
each form. A group has a few blocks of maps, which are never changed: a new map comes in a block of its own,
small blocks become one, and what a block has of a map that has changed or gone is passed over.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from ...bit_exact.sample import rows_by_chance
from ...descriptor import Described, rows_of
from ..config import DescriptorConfig, SearchConfig
from ..retrieval.key_search import build_key_search
from .coarse_templates import CoarseTemplates
from .sought_scan import SoughtScan

MAX_TEMPLATES = 14_000_000  # of all maps together. Each takes 80 bytes of memory, and its bits on the disk
MAX_BLOCKS = 6  # of a group: a query searches all of them
NUMBERS = 64  # that are left of a key: its principal components
LEARNED_FROM = 10_000  # keys
COMPARED = 400  # templates, for each spot of a scan
_KEYS_AT_ONCE = 4096
_CONFIG: TypeAdapter[DescriptorConfig] = TypeAdapter(DescriptorConfig)


class _Member(NamedTuple):
    """A map in a block.

    Attributes:
        token: of these templates: the index knows those that count by it.
    """

    map_id: str
    token: object
    templates: CoarseTemplates


class _Block:
    """Templates of some maps with their keys: m maps, n templates. Immutable.

    The descriptions lie in a file without a name: they are many gigabytes where there are thousands of maps,
    and a query reads few of them. The kernel keeps what memory has room for.

    Args:
        members: of one form.
        directory: of the files.
    """

    def __init__(self, members: Sequence[_Member], directory: Path) -> None:
        self.members = [(one.map_id, one.token) for one in members]
        self.form = members[0].templates.form
        self._descriptor = _CONFIG.validate_json(self.form).make()
        counts = [len(one.templates) for one in members]
        self.most = max(counts)
        self._begin = np.concatenate([[0], np.cumsum(counts)])
        self._owner = np.repeat(np.arange(len(members), dtype=np.int32), counts)
        self._described = {
            name: _in_file([one.templates.described[name] for one in members], directory)
            for name in self._descriptor.arrays
        }
        self._mean, self._axes = self._principal()
        every = range(0, len(self), _KEYS_AT_ONCE)
        keys = _in_file([self._keys_of(slice(at, at + _KEYS_AT_ONCE)) for at in every], directory)
        self._keys = build_key_search(keys, SearchConfig())

    def __len__(self) -> int:
        return int(self._begin[-1])

    def templates_of(self, number: int) -> CoarseTemplates:
        """The templates of a map, by its place among the members. They stay in the file."""
        return CoarseTemplates(
            self.form, rows_of(self._described, slice(self._begin[number], self._begin[number + 1]))
        )

    def similarities(self, scan: Described, visible: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Similarity of each map's most similar template, of those that were compared: (m,), 0 without one.

        Args:
            scan: a row for each spot.
            visible: (m,) maps that count.
        """
        best = np.zeros(len(self.members), np.float32)
        if not visible.any():
            return best
        among = None if visible.all() else np.flatnonzero(visible[self._owner])
        found = [self._nearest(key, among, visible) for key in self._projected(scan)]
        rows = np.unique(np.concatenate(found))
        templates = rows_of(self._described, rows)
        for spot, near in enumerate(map(np.sort, found)):
            one = rows_of(scan, slice(spot, spot + 1))
            _, score = self._descriptor.match(one, templates, np.searchsorted(rows, near))
            np.maximum.at(best, self._owner[near], score)
        return best

    def _nearest(
        self, key: NDArray[np.float32], among: NDArray[np.intp] | None, visible: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        if among is None:
            return self._keys.search(key, COMPARED)
        if len(among) <= COMPARED:
            return among.astype(np.int64)
        if 2 * len(among) > len(self):  # most count: to pass over the others is quicker than to read all keys
            found = self._keys.search(key, 4 * COMPARED)
            found = found[visible[self._owner[found]]]
            if len(found) >= COMPARED:
                return found[:COMPARED]
        return self._keys.search_among(key, among, COMPARED)

    def _keys_of(self, rows: slice) -> NDArray[np.float32]:
        return self._projected(rows_of(self._described, rows))

    def _projected(self, described: Described) -> NDArray[np.float32]:
        """(k, numbers) keys of k descriptions, along the principal axes."""
        keys = self._descriptor.keys(described) - self._mean
        return np.asarray(keys @ self._axes, np.float32)

    def _principal(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and principal axes of the keys: (d,) and (d, numbers)."""
        keys = self._descriptor.keys(rows_of(self._described, rows_by_chance(len(self), LEARNED_FROM)))
        mean: NDArray[np.float32] = keys.mean(axis=0, dtype=np.float32)
        scatter = (keys - mean).T.astype(np.float64) @ (keys - mean)
        axes = np.linalg.eigh(scatter)[1][:, -NUMBERS:]
        return mean, np.ascontiguousarray(axes, np.float32)


def _in_file(parts: Sequence[NDArray[Any]], directory: Path) -> NDArray[Any]:
    """One array of the rows of all parts, in a file that goes with it."""
    first, count = parts[0], sum(map(len, parts))
    with TemporaryFile(dir=directory) as file:
        whole = np.memmap(file, first.dtype, "w+", shape=(count, *first.shape[1:]))
    at = 0
    for part in parts:
        whole[at : at + len(part)] = part
        at += len(part)
    return whole


class CoarseIndex:
    """Templates of all maps, to choose those that may hold a scan. Thread-safe.

    Searches never wait for a change: it makes new blocks beside the old ones. Changes wait for each other.

    Args:
        directory: of temporary files, which have no names.
        max_templates: of all maps together. With many maps each has fewer.
    """

    def __init__(self, directory: Path, max_templates: int = MAX_TEMPLATES) -> None:
        self._directory = directory
        self._max_templates = max_templates
        self._changing = threading.Lock()
        self._state: tuple[dict[str, object], tuple[_Block, ...]] = {}, ()  # replaced, never changed

    def __len__(self) -> int:
        return len(self._state[0])

    def __contains__(self, map_id: object) -> bool:
        return map_id in self._state[0]

    @property
    def forms(self) -> tuple[str, ...]:
        """Forms of the descriptors of the maps."""
        return tuple(dict.fromkeys(block.form for block in self._state[1]))

    @property
    def templates(self) -> int:
        """Number of templates in memory, with those of maps that have gone since."""
        return sum(map(len, self._state[1]))

    def change(self, new: Mapping[str, CoarseTemplates], gone: Iterable[str] = (), expected: int = 0) -> None:
        """Add maps, in place of their templates so far, and removes others. Takes seconds for many.

        Args:
            expected: number of maps that there will be, if it is known to be more.
        """
        with self._changing:
            tokens, blocks = self._state
            left_out = {*gone, *new}
            tokens = {name: token for name, token in tokens.items() if name not in left_out}
            added = [_Member(name, object(), one) for name, one in new.items()]
            tokens |= {one.map_id: one.token for one in added}
            most = self._most_of_a_map(max(expected, len(tokens)))
            forms = dict.fromkeys([block.form for block in blocks] + [one.templates.form for one in added])
            changed: list[_Block] = []
            for form in forms:
                own = [block for block in blocks if block.form == form]
                fresh = [one for one in added if one.templates.form == form]
                changed += self._blocks_of(own, fresh, tokens, most)
            self._state = tokens, tuple(changed)

    def best(self, scan: SoughtScan, sees: Callable[[str], bool], count: int) -> list[str]:
        """At most ``count`` maps, the one with the most similar templates first.

        Args:
            sees: whether a map may be chosen. The others change nothing.
        """
        tokens, blocks = self._state
        total: dict[str, float] = {}
        for block in blocks:
            scans = scan.described.get(block.form, ())
            if not scans:
                continue
            visible = np.array(
                [tokens.get(name) is token and sees(name) for name, token in block.members], np.bool_
            )
            score = np.sum([block.similarities(one, visible) for one in scans], axis=0)
            total.update((block.members[row][0], float(score[row])) for row in np.flatnonzero(score))
        return sorted(total, key=lambda name: (-total[name], name))[:count]

    def _most_of_a_map(self, maps: int) -> int:
        """Templates that each of so many maps may have. By steps, because a change makes all blocks anew."""
        room = max(1.0, self._max_templates / max(1, maps))
        return int(2 ** (np.floor(4 * np.log2(room)) / 4))

    def _blocks_of(
        self, blocks: Sequence[_Block], added: list[_Member], tokens: Mapping[str, object], most: int
    ) -> list[_Block]:
        """The blocks of one form: those that are still worth it, and one of all other maps."""

        def valid(block: _Block) -> list[int]:
            return [k for k, (name, token) in enumerate(block.members) if tokens.get(name) is token]

        kept = [
            block for block in blocks if block.most <= most and 2 * len(valid(block)) > len(block.members)
        ]
        kept.sort(key=len, reverse=True)
        count = sum(len(one.templates) for one in added)
        if added or len(kept) < len(blocks):
            while kept and (len(kept) >= MAX_BLOCKS or len(kept[-1]) <= count):
                count += len(kept.pop())
        members = list(added)
        for block in blocks:
            if block not in kept:
                members += [_Member(*block.members[k], block.templates_of(k)) for k in valid(block)]
        thin = [one._replace(templates=one.templates.first(most)) for one in members]
        return [*kept, _Block(thin, self._directory)] if thin else kept
