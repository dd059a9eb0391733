"""A chunk as it goes to a worker of a cluster, and what that worker does with it. Knows nothing of Dask."""

from __future__ import annotations

import socket
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from threadpoolctl import threadpool_limits

from firstfix.builds.shared_stages import SharedStages
from firstfix.errors import BuildFailed
from firstfix.store.store import Store

from .chunks import ChunkResults, KeyedChunk, make_chunk
from .runtime import Runtime, this_runtime
from .stage_cache import StageCache, StageResult

KEPT_INPUTS = 4  # stages that a worker keeps at hand; the stage cache on its disk keeps more


@dataclass(frozen=True)
class ChunkJob:
    """All that a worker needs to know: a kilobyte or two. Credentials of the store are its own.

    Attributes:
        store: URL of the store that has the inputs and takes the result.
        inputs: keys of finished stages, by the chunk's names for them.
        runtime: of whoever hands it out.
    """

    store: str
    chunk: KeyedChunk
    inputs: Mapping[str, str]
    runtime: Runtime


def run_job(job: ChunkJob, folder: Path) -> None:
    """Makes the chunk's result, unless it is in the store.

    Args:
        folder: on the worker's disk, for inputs; workers of a machine may share it.

    Raises:
        BuildFailed: this worker's software differs.
        StoreUnavailable: an input cannot be had.
        whatever the chunk raises.
    """
    check_runtime(job.runtime)
    _one_blas_thread()
    store = _opened(job.store)
    if ChunkResults(store).has(job.chunk.key):
        return
    inputs = {name: _inputs.get(job.store, key, folder).directory for name, key in job.inputs.items()}
    make_chunk(store, job.chunk, inputs)


def check_runtime(wanted: Runtime) -> None:
    """Checks that this process has the same software as the process that hands out the chunks.

    Raises:
        BuildFailed: chunks made here might differ from those made elsewhere.
    """
    differs = wanted.differences(this_runtime())
    if differs:
        raise BuildFailed(f"the worker at {socket.gethostname()} has {differs}: its chunks could differ")


class _Inputs:
    """Stages that this process reads, locked on the disk as long as they are kept here."""

    def __init__(self) -> None:
        self._kept: OrderedDict[str, tuple[StageCache, StageResult]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, store: str, key: str, folder: Path) -> StageResult:
        with self._lock:
            if key not in self._kept:
                cache_of_one = StageCache(folder, shared=SharedStages(_opened(store)))
                self._kept[key] = (cache_of_one, cache_of_one.fetched(key))
            self._kept.move_to_end(key)
            while len(self._kept) > KEPT_INPUTS:
                self._kept.popitem(last=False)
            return self._kept[key][1]


_inputs = _Inputs()


@cache
def _opened(store: str) -> Store:
    return Store.open(store)


@cache
def _one_blas_thread() -> None:
    """For good: its sums depend on how many threads share them."""
    threadpool_limits(1, user_api="blas")
