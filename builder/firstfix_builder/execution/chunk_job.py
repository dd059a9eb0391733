"""Job of a worker in a cluster: one chunk, its inputs, and how it is run. Independent of Dask."""

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

KEPT_INPUTS = 4  # stages that a worker keeps open; the stage cache on its disk keeps more


@dataclass(frozen=True)
class ChunkJob:
    """Everything that a worker needs, in one or two kilobytes. The worker has its own store credentials.

    Attributes:
        store: URL of the store for the inputs and the result.
        inputs: keys of finished stages, by the names that the chunk uses.
        runtime: of the process that hands the chunk out.
    """

    store: str
    chunk: KeyedChunk
    inputs: Mapping[str, str]
    runtime: Runtime


def run_job(job: ChunkJob, folder: Path) -> None:
    """Make the chunk's result, unless it is in the store.

    Args:
        folder: on the worker's disk, for inputs; workers of a machine may share it.

    Raises:
        BuildFailed: this worker's software differs.
        StoreUnavailable: an input cannot be fetched.
        Exception: any error of the chunk.
    """
    check_runtime(job.runtime)
    _one_blas_thread()
    store = _opened(job.store)
    if ChunkResults(store).has(job.chunk.key):
        return
    inputs = {name: _inputs.get(job.store, key, folder).directory for name, key in job.inputs.items()}
    make_chunk(store, job.chunk, inputs)


def check_runtime(wanted: Runtime) -> None:
    """Check that this process has the same software as the process that hands out the chunks.

    Raises:
        BuildFailed: chunks made here might differ from those made elsewhere.
    """
    differs = wanted.differences(this_runtime())
    if differs:
        raise BuildFailed(f"the worker at {socket.gethostname()} has {differs}: its chunks could differ")


class _Inputs:
    """Stages that this process reads. They are locked on the disk as long as they are kept here."""

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
    """Limits BLAS to one thread for this process: its sums depend on the number of threads."""
    threadpool_limits(1, user_api="blas")
