"""The stages of a build in a work folder, as the pipeline makes them, with threads alone."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from threadpoolctl import threadpool_limits

from firstfix.builds.config import BuildConfig
from firstfix_builder.build_stages import BuildStages
from firstfix_builder.execution.chunks import ChunkCache
from firstfix_builder.execution.local_executor import LocalExecutor
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.execution.stage_runner import Progress, StageRunner


@contextmanager
def stages_below(
    work: Path, config: BuildConfig | None = None, progress: Progress = lambda *_: None
) -> Iterator[BuildStages]:
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(2) as threads:
        cache = StageCache(work)
        chunks = ChunkCache(cache, LocalExecutor(work, threads, threads))
        runner = StageRunner(cache, chunks, progress, lambda: False)
        yield BuildStages(runner, config or BuildConfig(), threads)
