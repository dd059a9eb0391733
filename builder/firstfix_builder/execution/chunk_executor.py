"""Interface for running chunks: here (``local_executor``) or on a cluster (``dask_executor``)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace

from firstfix.errors import StoreError
from firstfix.store.store import Store

from .chunks import Arrays, ChunkResults, KeyedChunk
from .stage_cache import StageResult

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
        """Runs all chunks of the batch. Their results are in the store when it returns.

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
    """Runs the chunks that have no result yet, then yields the results of all in order, one at a time.

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
