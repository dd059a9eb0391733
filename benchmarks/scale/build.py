"""A world's version, built once: later runs find its stages, and what each of them took."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

from firstfix.builds.config import BuildConfig
from firstfix_builder.execution.stage_cache import StageResult
from firstfix_builder.stage_files import engine_of, link

from .extent import Extent
from .stages import Cost, ScaleStages

MAX_RAYS = 5760  # of a template: 16 beams, a third of the default's, so that a million take half an hour
# What is fitted to a campus: a part of one is asked as the whole is, or their times would not compare.
ENGINE = {
    "descriptor": {"kind": "occupancy", "max_range_m": 41.0},
    "preprocess": {"min_range_m": 0.3, "max_range_m": 101.4, "voxel_m": 0.312},
    "verification": {"reach_m": 30.0},
}


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
    mesh: StageResult
    templates: StageResult
    learned: StageResult
    version: Path
    took: dict[str, Cost]


def build(extent: Extent, work: Path) -> Built:
    """The stages of ``pipeline.build_version``, in one process."""
    with _stages(extent, work) as stages:
        read, mesh, fitted, templates = _templates(stages, extent)
        engine = engine_of(fitted)
        clusters = stages.cluster(templates, engine)
        learned = stages.learn_keys(mesh, templates, engine)
        index = stages.build_index(read, mesh, fitted, templates, clusters, learned)
        tested = stages.self_test(mesh, index)
        version = work / extent.name
        shutil.rmtree(version, ignore_errors=True)
        version.mkdir()
        for path in sorted([*index.directory.iterdir(), *tested.directory.iterdir()]):
            link(path, version / path.name)
        return Built(extent, stages.config, mesh, templates, learned, version, dict(stages.took))


def make_world_templates(extent: Extent, work: Path) -> None:
    """Only the stages that take long."""
    with _stages(extent, work) as stages:
        _templates(stages, extent)


@contextmanager
def _stages(extent: Extent, work: Path) -> Iterator[ScaleStages]:
    config = BuildConfig.parse(
        {
            "sensor": "os1-64",
            "viewpoints": {"spacing_m": extent.spacing_m},
            "simulate": {"max_rays": MAX_RAYS},
            "engine": ENGINE,
            **extent.config,
        }
    )
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(os.cpu_count()) as threads:
        yield ScaleStages.below(work, extent.name, config, threads)


def _templates(
    stages: ScaleStages, extent: Extent
) -> tuple[StageResult, StageResult, StageResult, StageResult]:
    """The map as it is read, its mesh, the engine and the templates."""
    recipe = {"side": extent.side, "half_m": extent.half_m, "middle_m": extent.middle_m}
    world = stages.lasting.run("world", {}, recipe, extent.write).directory
    read = stages.read_map(world / "mesh.ply", world / "trajectory.txt")
    mesh = stages.reconstruct_mesh(read)
    viewpoints = stages.sample_viewpoints(read, mesh)
    fitted = stages.fit_engine(read, mesh, viewpoints)
    return read, mesh, fitted, stages.make_templates(mesh, viewpoints, engine_of(fitted))
