"""The stages of a build, each with its cost: what an interrupted run has spent counts too."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firstfix.builds.config import BuildConfig
from firstfix_builder.build_stages import BuildStages
from firstfix_builder.execution.chunks import ChunkCache
from firstfix_builder.execution.local_executor import LocalExecutor
from firstfix_builder.execution.stage_cache import StageCache, StageResult
from firstfix_builder.execution.stage_runner import StageRunner
from firstfix_builder.viewpoints.workload import Workload

from .spent import Cost, read_cost, spent

MAX_BYTES = 1 << 40  # nothing is pruned: the disk is the limit


@dataclass(frozen=True)
class MeasuringRunner(StageRunner):
    """Runs stages all in this process, whose memory is that of the build.

    Attributes:
        work: where all that is made lies.
        took: by stage, of those asked for so far.
    """

    work: Path = field(kw_only=True)
    took: dict[str, Cost] = field(default_factory=dict)

    @classmethod
    def below(cls, work: Path, threads: ThreadPoolExecutor) -> MeasuringRunner:
        """The runner of a world's stages."""
        (work / "costs").mkdir(parents=True, exist_ok=True)
        cache = StageCache(work, max_bytes=MAX_BYTES)
        executor = LocalExecutor(work, threads, threads, max_bytes=MAX_BYTES)
        return cls(cache, ChunkCache(cache, executor), lambda stage, fraction: None, lambda: False, work=work)

    def build(self, config: BuildConfig, threads: ThreadPoolExecutor) -> BuildStages:
        """The stages of a world, which may be as large as one asks for."""
        return BuildStages(self, config, threads, workload=Workload(None))

    def stage(
        self, name: str, inputs: Mapping[str, str], config: Any, produce: Callable[[Path], None]
    ) -> StageResult:
        """The result of a stage, and what it took."""
        cost = self.work / "costs" / f"{name}-{self.cache.key_of(name, inputs, config)}.json"

        def measured(out: Path) -> None:
            with spent(cost):
                produce(out)

        result = super().stage(name, inputs, config, measured)
        self.took[name] = read_cost(cost)
        shutil.rmtree(self.work / "chunks" / "stages", ignore_errors=True)  # they are in the stage now
        return result
