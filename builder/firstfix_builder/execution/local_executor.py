"""Chunks on this machine: in threads, and in processes for work that holds the interpreter lock."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, wait
from functools import cache
from pathlib import Path

from firstfix.builds.shared_stages import collect_stages
from firstfix.errors import BuildCancelled, BuildFailed, StoreError
from firstfix.store.store import Store

from .chunk_executor import ChunkBatch, ChunkExecutor
from .chunks import Chunk, make_chunk
from .stage_cache import DEFAULT_MAX_AGE_S

POLL_S = 0.5


class LocalExecutor(ChunkExecutor):
    """Runs chunks here, and keeps results in the build's work folder: a killed build resumes within a stage.

    Args:
        work: the build's folder.
    """

    def __init__(self, work: Path, threads: Executor, processes: Executor) -> None:
        self._folder = (work / "chunks").absolute()
        self._threads = threads
        self._processes = processes
        self.store = Store.open(str(self._folder))
        collect_stages(self.store, DEFAULT_MAX_AGE_S)

    def run(self, batch: ChunkBatch) -> None:
        """Runs all chunks of the batch in threads or processes of this machine."""
        folders = {name: result.directory for name, result in batch.inputs.items()}
        pending = set()
        try:
            for chunk in batch.chunks:
                pool = self._processes if chunk.keeps_interpreter else self._threads
                pending.add(pool.submit(_make, str(self._folder), batch.stage, chunk, folders))
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


def _make(store: str, stage: str, chunk: Chunk, inputs: Mapping[str, Path]) -> None:
    try:
        make_chunk(_opened(store), stage, chunk, inputs)
    except StoreError as error:  # not the store of maps, which may come back
        raise BuildFailed(f"the work folder took no result, its disk may be full: {error}") from None


@cache
def _opened(store: str) -> Store:
    return Store.open(store)
