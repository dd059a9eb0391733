"""The build flow: a map becomes a version's files. ``BuildStages.index_map`` lists the stages between."""

from __future__ import annotations

import importlib
import logging
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

from threadpoolctl import threadpool_limits

from firstfix.builds.config import BuildConfig, LearnKeysConfig
from firstfix.builds.options import PROVISIONAL, STAGES, BuildOptions
from firstfix.errors import BuildFailed

from .build_stages import BuildStages
from .execution.chunks import ChunkCache, ChunkExecutor
from .execution.freed_memory import return_large_blocks
from .execution.library_versions import libraries_of
from .execution.local_executor import LocalExecutor, die_with_parent
from .execution.stage_cache import StageCache, StagesElsewhere
from .execution.stage_runner import Progress, StageRunner
from .job.build_job import BuildResult
from .quick.quick_version import QuickVersion, posed_cloud_of
from .rebuild.base_version import BaseVersion
from .self_test.confirmed_scans import decode_confirmed
from .sources.read_map.posed_cloud import PosedCloud
from .sources.read_source import readers
from .stage_results import LevelMap
from .version_folder import collect_version, write_manifest
from .viewpoints.workload import Workload

_log = logging.getLogger(__name__)
_ALONE = BuildOptions()
CONFIRMED = "confirmed"  # folder below the work folder
# Of the provisional version that is made of a map's surface.
COARSER = 1.5  # cells of the surface, against those that follow the points' spacing
BLOCK_CELLS = 128  # edge of a block of the surface: small ones, so that all processors work
MAX_RAYS = 4096  # of a simulated scan
NEAR_TRAJECTORY_M = 4.0


def build_version(
    source: Path,
    config: BuildConfig,
    work: Path,
    *,
    trajectory: Path | None = None,
    confirmed: Path | None = None,
    base: Path | None = None,
    progress: Progress = lambda stage, fraction: None,
    cancelled: Callable[[], bool] = lambda: False,
    shared: StagesElsewhere | None = None,
    publish_provisional: Callable[[BuildResult], None] | None = None,
    options: BuildOptions = _ALONE,
) -> BuildResult:
    """Run every stage that the cache under ``work`` does not hold yet.

    Args:
        source: a map file or folder, as ``read_map`` takes it, a folder of sessions with a
            ``sessions.yaml``, or the folder of a patch (``job.patch_source``).
        trajectory: poses of the mapping run, if they are not in the source.
        confirmed: folder of confirmed queries (``job.confirmed_queries``), which the self-test asks too.
        base: files of the version that the config names as its base (``job.base_source``).
        shared: finished stages of other machines.
        publish_provisional: called with the provisional version when it is ready; None: none is made.
        options: of these ``executor`` and ``store`` say where chunks are run, and ``max_templates`` counts.

    Raises:
        InputError: the source or the trajectory cannot be read.
        BuildFailed: a stage could not do its work.
        BuildCancelled: cancelled() said so.
        ClusterUnavailable: the cluster is gone; its results so far are in the store.
    """
    return_large_blocks()
    with (
        threadpool_limits(1, user_api="blas"),  # sums of BLAS depend on the number of threads
        ThreadPoolExecutor(os.cpu_count()) as threads,
        _chunk_executor(options, work, threads) as executor,
    ):
        cache = StageCache(work, shared=shared)
        chunks = ChunkCache(cache, executor, shared)
        workload = Workload(options.max_templates)
        runner = StageRunner(cache, chunks, progress, cancelled)
        build = BuildStages(runner, config, threads, workload=workload)
        if publish_provisional is None:
            read = build.read_map(source, trajectory)
        else:
            read = _read_and_publish_early(build, source, trajectory, work, publish_provisional)
        made = build.index_map(read, BaseVersion.of(base, config, read.digest))
        drawn = build.draw_cloud(read, made.index)
        with _decoded(confirmed, work) as scans:
            tested = build.self_test(read, made.mesh, made.viewpoints, made.index, scans, made.kept)
        compared = build.compare_patch(source, read, made.mesh, made.index, tested)
        return collect_version(
            config, read, [made.index, drawn, tested], work / "version", compared=compared, kept=made.kept
        )


def _read_and_publish_early(
    build: BuildStages,
    source: Path,
    trajectory: Path | None,
    work: Path,
    publish: Callable[[BuildResult], None],
) -> LevelMap:
    """The map that was read, of which a provisional version is published as soon as there can be one.

    Where it has the poses of a mapping run, that is while it is read. Else it is made of the map's surface.
    """

    def publish_quick(made: Path, cloud: PosedCloud) -> None:
        record = {"findings": list(cloud.findings)}
        manifest = write_manifest(made, build.config, cloud.T_map_level, record, provisional=True)
        publish(BuildResult(made, manifest))

    quick = QuickVersion(build.config, work / PROVISIONAL, build.threads, publish_quick)
    read = build.read_map(source, trajectory, quick.make)
    build.runner.progress(PROVISIONAL, 0.0)
    if not quick.is_tried and (cloud := posed_cloud_of(read)) is not None:  # the map was read before
        quick.make(cloud)
    if not quick.is_published:
        early = _provisional(build, read, work)
        if early is not None:
            publish(early)
    return read


def _provisional(build: BuildStages, read: LevelMap, work: Path) -> BuildResult | None:
    """The provisional version of a map's surface; None if it cannot be made: the full build says why.

    Its stages count as one.
    """

    def progress(stage: str, fraction: float) -> None:
        build.runner.progress(PROVISIONAL, (STAGES.index(stage) + fraction) / len(STAGES))

    coarse = replace(build.for_config(provisional_config(build.config), progress), provisional=True)
    try:
        read = coarse.thin_map(read)
        index = coarse.index_map(read).index
        tested = coarse.assume_prior(index)
    except BuildFailed as error:
        _log.warning("no provisional version: %s", error)
        return None
    return collect_version(coarse.config, read, [index, tested], work / PROVISIONAL, provisional=True)


def provisional_config(config: BuildConfig) -> BuildConfig:
    """The config of the provisional version: the same place and sensor, with a fraction of the work.

    Its surface is coarse. Templates stand near the trajectory if there is one. Keys are not learned.
    """
    reconstruct, viewpoints = config.reconstruct, config.viewpoints
    near_m = min(viewpoints.max_distance_to_trajectory_m or NEAR_TRAJECTORY_M, NEAR_TRAJECTORY_M)
    return config.model_copy(
        update={
            "reconstruct": reconstruct.model_copy(
                update={
                    "surface": "signed-distance",
                    "cell_m": None if reconstruct.cell_m is None else COARSER * reconstruct.cell_m,
                    "cell_spacings": COARSER * reconstruct.spacings_per_cell,
                    "tile_cells": min(reconstruct.cells_per_tile, BLOCK_CELLS),
                }
            ),
            "viewpoints": viewpoints.model_copy(update={"max_distance_to_trajectory_m": near_m}),
            "simulate": config.simulate.model_copy(
                update={"max_rays": min(config.simulate.max_rays, MAX_RAYS)}
            ),
            "learn_keys": LearnKeysConfig(scans=0),
        }
    )


def get_ready() -> None:
    """Import what is imported late, and look up what a build looks up, while there is no map to read."""
    readers()
    libraries_of(STAGES[0])
    with suppress(ImportError):  # few maps are LAS, and they say what is missing
        importlib.import_module("laspy")


def read_source(
    source: Path,
    config: BuildConfig,
    work: Path,
    *,
    trajectory: Path | None = None,
    confirmed: Path | None = None,
    progress: Progress = lambda stage, fraction: None,
    cancelled: Callable[[], bool] = lambda: False,
    shared: StagesElsewhere | None = None,
    options: BuildOptions = _ALONE,
) -> None:
    """Run the first stage alone and decode what is confirmed; raises as ``build_version`` does.

    ``build_version`` with the same arguments then finds its result and parses no file of the source.
    """
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(1) as threads:
        executor = LocalExecutor(work, threads, threads)
        cache = StageCache(work, shared=shared)
        chunks = ChunkCache(cache, executor)
        workload = Workload(options.max_templates)
        runner = StageRunner(cache, chunks, progress, cancelled)
        BuildStages(runner, config, threads, workload=workload).read_map(source, trajectory)
        if confirmed is not None:
            decode_confirmed(confirmed, work / CONFIRMED)


@contextmanager
def _decoded(confirmed: Path | None, work: Path) -> Iterator[Path | None]:
    """Folder with the scans of confirmed queries, which is removed at the end: they are sensor data."""
    if confirmed is None:
        yield None
        return
    try:
        decode_confirmed(confirmed, work / CONFIRMED)
        yield work / CONFIRMED
    finally:
        shutil.rmtree(work / CONFIRMED, ignore_errors=True)


@contextmanager
def _chunk_executor(options: BuildOptions, work: Path, threads: Executor) -> Iterator[ChunkExecutor]:
    """Run chunks by threads and processes of this machine, or by the workers of a cluster.

    A cluster's workers must reach the store, for inputs and results.
    """
    if options.scheduler is not None:
        from .execution.dask_executor import DaskExecutor

        with DaskExecutor(options.scheduler, options.store) as far:
            yield far
        return
    with ProcessPoolExecutor(
        os.cpu_count(), mp_context=get_context("spawn"), initializer=_begin_worker
    ) as processes:
        near = LocalExecutor(work, threads, processes)
        yield near
        near.prune()


def _begin_worker() -> None:
    """Set up a process that runs chunks."""
    die_with_parent()
    return_large_blocks()
