"""Runs the chunks of a stage, except those whose result is known from an earlier run.

A result is found by its key, a hash of the content that the chunk reads. It is searched for in the work
folder or in the cluster's store, then where finished stages are shared with other machines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from .build_trace import mark_chunks
from .chunk_executor import ChunkExecutor, run_chunks
from .chunks import Arrays, Chunk, ChunkResults, KeyedChunk
from .stage_cache import StageCache, StageResult, StagesElsewhere


@dataclass(frozen=True)
class ChunkCache:
    """The chunks of builds.

    Attributes:
        keys: makes the keys, which depend on the code's version.
        shared: where results are fetched from and shared besides; not used if other machines see the
            executor's store.
    """

    keys: StageCache
    executor: ChunkExecutor
    shared: StagesElsewhere | None = None

    def run(
        self,
        stage: str,
        chunks: Sequence[Chunk],
        inputs: Mapping[str, StageResult],
        progress: Callable[[float], None],
        cancelled: Callable[[], bool],
    ) -> Iterator[Arrays]:
        """Yields the results of all chunks in order, one at a time. Runs only the chunks without a result.

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
                results.keep(key)
            else:  # the rest of a result that is being removed
                found.discard(key)
        shared = None if self.executor.is_shared else self.shared
        if shared is not None:
            found |= {
                chunk.key for chunk in keyed if chunk.key not in found and _bring(results, shared, chunk.key)
            }
        mark_chunks(stage, len(keyed), sum(chunk.key in found for chunk in keyed))
        yield from run_chunks(self.executor, keyed, found, inputs, progress, cancelled)
        if shared is not None:
            for chunk in keyed:
                if chunk.key not in found:
                    _share(results, shared, stage, chunk.key)

    def _key(self, stage: str, chunk: Chunk, inputs: Mapping[str, StageResult]) -> str:
        return self.keys.key_of(f"{stage}/{chunk.work}", chunk.reads(inputs), chunk.plain_values)


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
