"""Runs chunks on this machine: in threads, or in processes if the work holds the interpreter lock."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, wait
from functools import cache
from pathlib import Path

from firstfix.builds.shared_stages import collect_stages
from firstfix.errors import BuildCancelled, BuildFailed, StoreError
from firstfix.store.store import Store

from .chunk_executor import ChunkBatch, ChunkExecutor
from .chunks import KeyedChunk, make_chunk
from .stage_cache import DEFAULT_MAX_AGE_S

POLL_S = 0.5
DEFAULT_CHUNK_BYTES = 20_000_000_000


class LocalExecutor(ChunkExecutor):
    """Runs chunks here, and keeps results in the work folder of builds.

    So a killed build resumes within a stage, and the next build of a map reuses the unchanged chunks.

    Args:
        work: the folder; ``prune`` removes results by age and size.
    """

    def __init__(
        self, work: Path, threads: Executor, processes: Executor, *, max_bytes: int = DEFAULT_CHUNK_BYTES
    ) -> None:
        self._folder = (work / "chunks").absolute()
        self._threads = threads
        self._processes = processes
        self.store = Store.open(str(self._folder))
        self._max_bytes = max_bytes
        self.prune()

    def prune(self) -> None:
        """Removes results that were unused for too long, then the oldest ones beyond the size limit."""
        collect_stages(self.store, DEFAULT_MAX_AGE_S, max_bytes=self._max_bytes)

    def run(self, batch: ChunkBatch) -> None:
        """Runs all chunks of the batch in threads or processes of this machine."""
        folders = {name: result.directory for name, result in batch.inputs.items()}
        pending = set()
        try:
            for chunk in batch.chunks:
                pool = self._processes if chunk.chunk.keeps_interpreter else self._threads
                pending.add(pool.submit(_make, str(self._folder), chunk, folders))
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


def _make(store: str, chunk: KeyedChunk, inputs: Mapping[str, Path]) -> None:
    try:
        make_chunk(_opened(store), chunk, inputs)
    except StoreError as error:  # of the work folder: the build does not wait for it as for the store of maps
        raise BuildFailed(f"cannot write to the work folder, whose disk may be full: {error}") from None


@cache
def _opened(store: str) -> Store:
    return Store.open(store)
