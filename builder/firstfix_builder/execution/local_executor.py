"""Runs chunks on this machine: in threads, or in processes if the work holds the interpreter lock."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import TypeVar

from firstfix.builds.shared_stages import collect_stages
from firstfix.errors import BuildCancelled, BuildFailed, StoreError
from firstfix.store.store import Store

from .chunks import ChunkBatch, ChunkExecutor, KeyedChunk, make_chunk
from .stage_cache import DEFAULT_MAX_AGE_S

POLL_S = 0.5
DEFAULT_CHUNK_BYTES = 20_000_000_000
_T = TypeVar("_T")
_R = TypeVar("_R")


class LocalExecutor(ChunkExecutor):
    """Runs chunks here, and keeps results in the work folder of builds.

    So a killed build resumes within a stage, and the next build of a map reuses the unchanged chunks. Readers
    compare a result with its sha256, and one that a power cut has torn is made again: nothing is synced.

    Args:
        work: the folder; ``prune`` removes results by age and size.
    """

    def __init__(
        self, work: Path, threads: Executor, processes: Executor, *, max_bytes: int = DEFAULT_CHUNK_BYTES
    ) -> None:
        self._folder = (work / "chunks").absolute()
        self._threads = threads
        self._processes = processes
        self.store = Store.open_cache(self._folder)
        self._max_bytes = max_bytes
        self.prune()

    def prune(self) -> None:
        """Remove results that were unused for too long, then the oldest ones beyond the size limit."""
        collect_stages(self.store, DEFAULT_MAX_AGE_S, max_bytes=self._max_bytes)

    def run(self, batch: ChunkBatch) -> None:
        """Run all chunks of the batch in threads or processes of this machine."""
        folders = {name: result.directory for name, result in batch.inputs.items()}
        pending = set()
        try:
            for chunk in batch.chunks:
                pool = self._processes if chunk.chunk.keeps_interpreter else self._threads
                pending.add(pool.submit(_make, self._folder, chunk, folders))
            while pending:
                if batch.cancelled():
                    raise BuildCancelled("cancelled between the chunks of a stage")
                ended, pending = wait(pending, POLL_S, FIRST_COMPLETED)
                for future in ended:
                    future.result()
                    batch.done()
        except BrokenExecutor as error:
            raise BuildFailed("a worker process died, maybe out of memory") from error
        finally:
            for future in pending:
                future.cancel()


def _make(store: Path, chunk: KeyedChunk, inputs: Mapping[str, Path]) -> None:
    try:
        make_chunk(_opened(store), chunk, inputs)
    except StoreError as error:  # of the work folder: the build does not wait for it as for the store of maps
        raise BuildFailed(f"cannot write to the work folder, whose disk may be full: {error}") from None


@cache
def _opened(store: Path) -> Store:
    return Store.open_cache(store)


def in_turn(function: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[tuple[_T, _R]]:
    """Yield each item with the function's result, in order. There is one thread for each processor.

    The threads are only a few items ahead of the caller, so few results are in memory. For one item alone no
    thread is started.
    """
    workers = os.cpu_count() or 1
    waiting: deque[tuple[_T, Future[_R]]] = deque()
    following = iter(items)
    first_two = list(islice(following, 2))
    if len(first_two) < 2:
        yield from ((item, function(item)) for item in first_two)
        return
    with ThreadPoolExecutor(workers) as threads:
        for item in chain(first_two, following):
            waiting.append((item, threads.submit(function, item)))
            if len(waiting) > 2 * workers:
                first, future = waiting.popleft()
                yield first, future.result()
        for item, future in waiting:
            yield item, future.result()


def die_with_parent() -> None:
    """End this process when its parent ends. For ``ProcessPoolExecutor(initializer=...)``.

    Without it the processes of a pool would wait for ever after a kill -9 of the parent: each holds both ends
    of the pipe through which it gets its work.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="die-with-parent").start()
