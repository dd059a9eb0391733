"""Running one stage of a build: from the cache or anew, in this process or in chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firstfix.errors import BuildCancelled

from .chunk_executor import ChunkExecutor, run_chunks
from .chunks import Arrays, Chunk, ChunkResults
from .stage_cache import StageCache, StageResult

Progress = Callable[[str, float], None]
RunChunks = Callable[[Sequence[Chunk]], Iterator[Arrays]]


@dataclass(frozen=True)
class StageRunner:
    """Runs stages, reports their progress and stops between them when the build is cancelled.

    Attributes:
        progress: called with a stage's name and the share of it that is done.
        cancelled: whether the build is to stop.
    """

    cache: StageCache
    executor: ChunkExecutor
    progress: Progress
    cancelled: Callable[[], bool]

    def _stage(
        self, name: str, inputs: Mapping[str, str], config: Any, produce: Callable[[Path], None]
    ) -> StageResult:
        """A stage that this process makes, unless the cache has it."""
        if self.cancelled():
            raise BuildCancelled(f"cancelled before {name}")
        self.progress(name, 0.0)
        result = self.cache.run(name, inputs, config, produce)
        self.progress(name, 1.0)
        return result

    def _chunked_stage(
        self,
        name: str,
        inputs: Mapping[str, StageResult],
        config: Any,
        produce: Callable[[Path, RunChunks], None],
    ) -> StageResult:
        """A stage whose chunks the executor runs. No chunk is run twice."""
        digests = {reads: result.digest for reads, result in inputs.items()}
        key = self.cache.key_of(name, digests, config)

        def run(chunks: Sequence[Chunk]) -> Iterator[Arrays]:
            return run_chunks(self.executor, key, chunks, inputs, self._ticks(name), self.cancelled)

        result = self._stage(name, digests, config, lambda out: produce(out, run))
        ChunkResults(self.executor.store, key).remove()
        return result

    def _ticks(self, stage: str) -> Callable[[float], None]:
        return lambda fraction: self.progress(stage, fraction)
