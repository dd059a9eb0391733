"""Chunks of a stage: small descriptions of work, and their results in an object store.

    stages/<key>/<sha256>      the arrays that one chunk made
    stages/<key>/stage.json    written last

The layout is that of shared stages (``firstfix.builds.shared_stages``): chunks are shared and expire in the
same way. The key is a hash of everything that determines the result: the kind of work, its values, the code,
and the content that the chunk reads. So a key has one result, for all machines, maps and versions, and an
existing result is never made again. Workers write the arrays directly to the store; they do not pass through
the process that hands out the work.
"""

from __future__ import annotations

import json
import os
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from functools import cached_property
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.shared_stages import RECORD, ROOT, SharedStages
from firstfix.engine.made_of import Arrays as Arrays
from firstfix.errors import BuildCancelled, StoreError
from firstfix.store.store import Store

from .build_trace import mark_chunks
from .stage_cache import StageCache, StageResult, StagesElsewhere

_FILE = "arrays.npz"
RENEWED_AFTER = timedelta(days=1)  # a put takes a while, and a build uses thousands of results
MESH = "mesh"  # the input that holds a map's surface


class SurfaceChange(Protocol):
    """The change of the surface since a version before (``simulation.changed_surface``)."""

    @property
    def before(self) -> StageResult:
        """The surface before, as far as the hashes of ``Chunk.reads`` need it."""
        ...

    def is_met(self, origins: NDArray[np.floating], rays: Any, reach_m: float, most_m: float) -> bool:
        """Whether a ray (``simulation.rays.Rays``) from any of (n, 3) origins may meet the change."""
        ...


@dataclass(frozen=True)
class Chunk(ABC):
    """A part of a stage's work: a pure function and its arguments, which are plain values. Picklable.

    Attributes:
        keeps_interpreter: the work holds the interpreter lock, so it runs in a process, not in a thread.
    """

    keeps_interpreter: ClassVar[bool] = False

    @abstractmethod
    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The chunk's arrays: the same bytes on every machine.

        Args:
            inputs: folders of the finished stages that it reads, by the names that it uses.
        """

    @property
    def values(self) -> dict[str, Any]:
        """The values that determine the result, besides the content that the chunk reads."""
        return asdict(self)

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of everything that ``run`` reads, by any names. Cheap: it hashes nothing large.

        Chunks with equal values and equal hashes have equal results. By default these are the digests of
        whole stages. A chunk that reads only a part of a map returns the hash of that part.
        """
        return {name: result.digest for name, result in inputs.items()}

    def sees(self, change: SurfaceChange, inputs: Mapping[str, StageResult]) -> bool:
        """Whether the result may differ from the one before a change that lies within what the chunk reads.

        By default it may. A chunk of rays tells by them.
        """
        return True

    @property
    def work(self) -> str:
        """Name of the kind of work."""
        return type(self).__qualname__

    @property
    def plain_values(self) -> dict[str, Any]:
        """``values`` as JSON."""
        text = json.dumps(self.values, sort_keys=True, default=lambda model: model.model_dump(mode="json"))
        plain: dict[str, Any] = json.loads(text)
        return plain


@dataclass(frozen=True)
class KeyedChunk:
    """A chunk with the key of its result."""

    key: str
    chunk: Chunk


class ChunkResults:
    """The results of chunks in one store."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._entries = SharedStages(store)

    def made(self) -> set[str]:
        """The keys that have a result, or a partly removed one."""
        return set(self._store.folders(ROOT))

    def has(self, key: str) -> bool:
        """Whether a chunk has a result."""
        return self._store.exists(f"{ROOT}/{key}/{RECORD}")

    def put(self, key: str, arrays: Arrays) -> None:
        """Store a result, completely or not at all."""
        content, named = BytesIO(), dict[str, Any](arrays)
        np.savez(content, **named)
        self._entries.put_content(key, "chunk", _FILE, content.getvalue())

    def put_folder(self, key: str, folder: Path) -> None:
        """Store a result from the files of another store."""
        self._entries.put_surely(key, "chunk", folder)

    def fetch(self, key: str, folder: Path) -> bool:
        """Write the files of a result into an empty folder. Returns whether there is one, undamaged."""
        return self._entries.fetch(key, folder)

    def load(self, key: str) -> Arrays | None:
        """A result, or None if there is none. A damaged result is removed."""
        found = self._entries.read(key)
        if found is None:
            return None
        try:
            with np.load(BytesIO(found[_FILE]), allow_pickle=False) as content:
                return dict(content)
        except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile):
            self.remove(key)
            return None

    def keep(self, key: str, now: datetime) -> None:
        """Renew the age of a result that was used, so that it expires later. One of today is young enough.

        Args:
            now: by the store's clock.
        """
        where = f"{ROOT}/{key}/{RECORD}"
        if now - self._store.last_modified(where) > RENEWED_AFTER:
            self._store.put(where, self._store.get(where))

    def remove(self, key: str) -> None:
        """Remove a result."""
        for name in (f"{ROOT}/{key}/{RECORD}", *self._store.list(f"{ROOT}/{key}")):
            self._store.delete(name)


def make_chunk(store: Store, keyed: KeyedChunk, inputs: Mapping[str, Path]) -> None:
    """Run a chunk and store its result."""
    ChunkResults(store).put(keyed.key, keyed.chunk.run(inputs))


TRIES = 3  # further attempts, if a result is damaged or gone when it is read


@dataclass(frozen=True)
class ChunkBatch:
    """Chunks of one stage that are to be run.

    Attributes:
        inputs: finished stages that the chunks read, by the names that the chunks use.
        done: called after each chunk.
        cancelled: returns whether the build is cancelled.
    """

    chunks: Sequence[KeyedChunk]
    inputs: Mapping[str, StageResult]
    done: Callable[[], None]
    cancelled: Callable[[], bool]


class ChunkExecutor(ABC):
    """Runs chunks and puts their results into a store.

    Attributes:
        store: stores the results.
        is_shared: whether other machines see the store.
    """

    store: Store
    is_shared: bool = False

    @abstractmethod
    def run(self, batch: ChunkBatch) -> None:
        """Run all chunks of the batch. Their results are in the store when it returns.

        Raises:
            BuildCancelled: the build was cancelled; no further chunk was started.
            BuildFailed: a chunk ended the processes that ran it.
            ClusterUnavailable: the machines that run chunks are gone.
            Exception: any error of a chunk.
        """


def run_chunks(
    executor: ChunkExecutor,
    chunks: Sequence[KeyedChunk],
    made: Set[str],
    inputs: Mapping[str, StageResult],
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> Iterator[Arrays]:
    """Run the chunks that have no result yet, then yield the results of all in order, one at a time.

    Args:
        made: keys that have a result.

    Raises:
        StoreError: a result is damaged or gone, repeatedly.
        Exception: any error of ``ChunkExecutor.run``.
    """
    results = ChunkResults(executor.store)
    missing = [chunk for chunk in chunks if chunk.key not in made]
    count = len(chunks) - len(missing)

    def done() -> None:
        nonlocal count
        count += 1
        progress(count / len(chunks))

    batch = ChunkBatch(missing, inputs, done, cancelled)
    executor.run(batch)
    for chunk in chunks:
        arrays, tries = results.load(chunk.key), TRIES
        while arrays is None:
            if tries == 0:
                raise StoreError(f"the store does not keep chunk {chunk.key[:12]}")
            tries -= 1
            executor.run(replace(batch, chunks=[chunk], done=lambda: None))
            arrays = results.load(chunk.key)
        yield arrays


@dataclass(frozen=True)
class ChunkCache:
    """The chunks of builds.

    Attributes:
        keys: makes the keys, which depend on the code's version.
        shared: where results are fetched from and shared besides; not used if other machines see the
            executor's store.
        change: of the surface since the version before, whose results are taken over where no ray meets it.
    """

    keys: StageCache
    executor: ChunkExecutor
    shared: StagesElsewhere | None = None
    change: SurfaceChange | None = None

    @cached_property
    def _began(self) -> datetime:
        """When it first used a result, by the store's clock, which costs a put: too much for each."""
        return self.executor.store.now()

    def run(
        self,
        stage: str,
        chunks: Sequence[Chunk],
        inputs: Mapping[str, StageResult],
        progress: Callable[[float], None],
        cancelled: Callable[[], bool],
    ) -> Iterator[Arrays]:
        """Yield the results of all chunks in order, one at a time. Runs only the chunks without a result.

        Args:
            stage: its name.

        Raises:
            Exception: any error of ``run_chunks``.
        """
        results = ChunkResults(self.executor.store)
        keyed = [KeyedChunk(self._key(stage, chunk, inputs), chunk) for chunk in chunks]
        found = results.made() & {chunk.key for chunk in keyed}
        for key in sorted(found):
            if results.has(key):
                results.keep(key, self._began)
            else:  # the rest of a result that is being removed
                found.discard(key)
        shared = None if self.executor.is_shared else self.shared
        if shared is not None:
            found |= {
                chunk.key for chunk in keyed if chunk.key not in found and _bring(results, shared, chunk.key)
            }
        if self.change is not None:
            missing = [chunk for chunk in keyed if chunk.key not in found]
            found |= self._taken_over(self.change, results, stage, missing, inputs, cancelled)
        mark_chunks(stage, len(keyed), sum(chunk.key in found for chunk in keyed))
        yield from run_chunks(self.executor, keyed, found, inputs, progress, cancelled)
        if shared is not None:
            for chunk in keyed:
                if chunk.key not in found:
                    _share(results, shared, stage, chunk.key)

    def made_of(
        self, stage: str, work: str, content: Sequence[NDArray[Any]], make: Callable[[], Arrays]
    ) -> Arrays:
        """The arrays that this process makes of others, or that an earlier build made of the same.

        For one stage it is a ``MadeOf``.
        """
        digest = sha256()
        for array in content:
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).view(np.uint8).data)
        key = self.keys.key_of(f"{stage}/{work}", {"content": digest.hexdigest()}, {})
        results = ChunkResults(self.executor.store)
        shared = None if self.executor.is_shared else self.shared
        if results.has(key) or (shared is not None and _bring(results, shared, key)):
            found = results.load(key)
            if found is not None:
                results.keep(key, self._began)
                return found
        made = make()
        results.put(key, made)
        if shared is not None:
            _share(results, shared, stage, key)
        return made

    def _taken_over(
        self,
        change: SurfaceChange,
        results: ChunkResults,
        stage: str,
        chunks: Sequence[KeyedChunk],
        inputs: Mapping[str, StageResult],
        cancelled: Callable[[], bool],
    ) -> set[str]:
        """Take results of the surface before for chunks that do not see its change. Returns their keys."""
        inputs_before = {**inputs, MESH: change.before}

        def take(keyed: KeyedChunk) -> bool:
            if cancelled():
                raise BuildCancelled(f"cancelled during {stage}")
            key_before = self._key(stage, keyed.chunk, inputs_before)
            if not results.has(key_before) or keyed.chunk.sees(change, inputs):
                return False
            return _copied(results, key_before, keyed.key)

        if MESH not in inputs:
            return set()
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            taken = list(threads.map(take, chunks))
        return {one.key for one, is_taken in zip(chunks, taken, strict=True) if is_taken}

    def _key(self, stage: str, chunk: Chunk, inputs: Mapping[str, StageResult]) -> str:
        return self.keys.key_of(f"{stage}/{chunk.work}", chunk.reads(inputs), chunk.plain_values)


def _copied(results: ChunkResults, key: str, to: str) -> bool:
    """Copy a result. Returns whether there is one, undamaged."""
    with TemporaryDirectory() as folder:
        if not results.fetch(key, Path(folder)):
            return False
        results.put_folder(to, Path(folder))
        return True


def _bring(results: ChunkResults, shared: StagesElsewhere, key: str) -> bool:
    with TemporaryDirectory() as folder:
        if not shared.fetch(key, Path(folder)):
            return False
        results.put_folder(key, Path(folder))
        return True


def _share(results: ChunkResults, shared: StagesElsewhere, stage: str, key: str) -> None:
    with TemporaryDirectory() as folder:
        if results.fetch(key, Path(folder)):
            shared.put(key, stage, Path(folder))
