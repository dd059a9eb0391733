"""Runs one stage of a build, unless its result is cached: in this process, or in chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firstfix.errors import BuildCancelled

from .chunks import Arrays, Chunk, ChunkCache
from .stage_cache import StageCache, StageResult

Progress = Callable[[str, float], None]
RunChunks = Callable[[Sequence[Chunk]], Iterator[Arrays]]


@dataclass(frozen=True)
class StageRunner:
    """Runs stages, reports their progress and stops between them when the build is cancelled.

    Attributes:
        chunks: runs the chunks that no build has run before.
        progress: called with a stage's name and the completed share, 0..1.
        cancelled: returns whether the build is cancelled.
    """

    cache: StageCache
    chunks: ChunkCache
    progress: Progress
    cancelled: Callable[[], bool]

    def stage(
        self, name: str, inputs: Mapping[str, str], config: Any, produce: Callable[[Path], None]
    ) -> StageResult:
        """Result of a stage that runs in this process, unless it is cached."""
        self.check_wanted(name)
        self.progress(name, 0.0)
        result = self.cache.run(name, inputs, config, produce)
        self.progress(name, 1.0)
        return result

    def chunked_stage(
        self,
        name: str,
        inputs: Mapping[str, StageResult],
        config: Any,
        produce: Callable[[Path, RunChunks], None],
        besides: Mapping[str, StageResult] | None = None,
        share: float = 1.0,
    ) -> StageResult:
        """A stage in chunks. Only those are run whose inputs have changed.

        Args:
            inputs: what chunks read, and perhaps this process.
            besides: further stages, which this process alone reads.
            share: of the stage's work that is in the chunks; ``produce`` tells the progress of the rest.
        """

        def run(chunks: Sequence[Chunk]) -> Iterator[Arrays]:
            return self.chunks.run(name, chunks, inputs, self.ticks(name, share), self.cancelled)

        digests = {reads: result.digest for reads, result in {**inputs, **(besides or {})}.items()}
        return self.stage(name, digests, config, lambda out: produce(out, run))

    def check_wanted(self, name: str) -> None:
        """Check that the build goes on, at a moment when it could end.

        Raises:
            BuildCancelled: it was cancelled.
        """
        if self.cancelled():
            raise BuildCancelled(f"cancelled at {name}")

    def ticks(self, stage: str, share: float = 1.0) -> Callable[[float], None]:
        """Report the progress of a part of a stage, 0..1."""
        return lambda fraction: self.progress(stage, share * fraction)
