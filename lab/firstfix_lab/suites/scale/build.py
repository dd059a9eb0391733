"""A world's version, built once: later runs find its stages, and what each of them took."""

from __future__ import annotations

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

from firstfix.builds.config import BuildConfig
from firstfix.engine.config import EngineConfig
from firstfix_builder.execution.stage_cache import StageResult
from firstfix_builder.stage_files import link
from firstfix_builder.stage_results import MapMesh

from ...common.worlds import WORLDS_SOURCE
from .extent import Extent
from .spent import Cost
from .stages import MeasuringRunner


@dataclass(frozen=True)
class Built:
    """A built world.

    Attributes:
        mesh: what its scans are simulated in.
        version: folder of the version's files, without a manifest.
        took: by stage.
    """

    extent: Extent
    config: BuildConfig
    mesh: MapMesh
    templates: StageResult
    learned: StageResult
    version: Path
    took: dict[str, Cost]

    @property
    def spacing_m(self) -> float:
        """Largest spacing of the templates."""
        return EngineConfig.load(self.version).spacing_m


def build(extent: Extent, work: Path) -> Built:
    """The stages of ``pipeline.build_version`` in one process, which finds what an earlier one has made."""
    config = BuildConfig.parse(
        {"sensor": "os1-64", "viewpoints": {"spacing_m": extent.spacing_m}, **extent.config}
    )
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(os.cpu_count()) as threads:
        runner = MeasuringRunner.below(work, threads)
        stages = runner.build(config, threads)
        recipe = {"extent_m": extent.extent_m}
        world = runner.cache.run("world", WORLDS_SOURCE, recipe, extent.write).directory
        read = stages.read_map(world / "mesh", None)
        mesh = stages.reconstruct_mesh(read)
        viewpoints = stages.sample_viewpoints(read, mesh)
        fitted = stages.fit_engine(read, viewpoints)
        engine = fitted.engine
        templates = stages.make_templates(mesh, viewpoints, engine)
        clusters = stages.cluster(templates, engine)
        learned = stages.learn_keys(mesh, templates, engine)
        carved = stages.carve_free_space(read, mesh, engine)
        index = stages.build_index(read, mesh, fitted, templates, clusters, learned, carved)
        tested = stages.self_test(read, mesh, viewpoints, index)
        version = work / extent.name
        shutil.rmtree(version, ignore_errors=True)
        version.mkdir()
        for path in sorted([*index.directory.iterdir(), *tested.directory.iterdir()]):
            link(path, version / path.name)
        return Built(extent, config, mesh, templates, learned, version, dict(runner.took))
