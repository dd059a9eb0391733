"""A map's templates made by threads and by a Dask cluster: the same bytes, how fast, and what kills cost.

    python -m benchmarks.dask_builds [--world campus] [--templates 108000] [--rays 16384] [--workers 1 2]
        [--kills 2] [--work DIR] [--quick] [--json FILE]

The stage that a large map's build spends its time in, over a world's mesh; what comes before it is made
once. Every worker is bound to one processor, so that one and two of them are one and two small machines.
In the last run workers are killed with SIGKILL as the work goes on, and replaced.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from firstfix.builds.config import BuildConfig
from firstfix_builder.build_stages import BuildStages
from firstfix_builder.execution.chunks import ChunkCache, ChunkExecutor
from firstfix_builder.execution.dask_executor import DaskExecutor
from firstfix_builder.execution.local_executor import LocalExecutor, die_with_parent
from firstfix_builder.execution.stage_cache import StageCache, StageResult
from firstfix_builder.stage_files import engine_of

from .common.dask_cluster import DaskCluster, dask_cluster
from .common.worlds import own_world

CAMPUS_M2 = 0.45**2 * 108_464  # of floor, where a viewpoint stands every 0.45 m


def dask_builds(
    folder: Path, *, world: str, templates: int, rays: int, workers: tuple[int, ...], kills: int
) -> dict[str, Any]:
    """The figures; ``same_bytes`` is to be true, and ``handed_out_again`` no more than two a kill.

    Args:
        folder: of all files; what is made from a world is kept in it for the next run.
        templates: about so many; the world's floors say how many exactly.
        rays: of a template, at most.
        workers: sizes of clusters.
    """
    base = own_world(world)
    files = base.make(StageCache(folder / "worlds")).map
    floor_m2 = CAMPUS_M2 if world == "campus" else _floor_m2(folder, base.config, files)
    spacing_m = round(float(np.sqrt(floor_m2 / templates)), 3)
    given = {"viewpoints": {"spacing_m": spacing_m}, "simulate": {"max_rays": rays}}
    config = BuildConfig.parse({**base.config, **given})
    with (
        threadpool_limits(1, user_api="blas"),
        ThreadPoolExecutor(os.cpu_count()) as threads,
        ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=die_with_parent) as processes,
    ):
        before = _Before(folder / "before", config, threads, processes, files.mesh, files.trajectory)
        near, near_s = before.templates(
            folder / _new("threads"), lambda work: LocalExecutor(work, threads, processes)
        )
        count = len(np.load(near.directory / "template_height_m.npy", mmap_mode="r"))
        figures: dict[str, Any] = {
            "world": world,
            "templates": count,
            "rays": rays,
            "chunks": before.chunks,
            "processors": os.cpu_count(),
            "threads_s": round(near_s, 1),
        }
        digests = {near.digest}
        for size in workers:
            place = folder / _new(f"dask-{size}")
            with dask_cluster(place / "cluster", size, bound=True) as cluster:
                cluster.wait_for_workers(size)
                far, far_s, handed = _far(before, cluster, place)
            digests.add(far.digest)
            figures[f"dask_{size}_s"] = round(far_s, 1)
            figures[f"dask_{size}_handed_out"] = handed
        if kills:
            place = folder / _new("kills")
            with dask_cluster(place / "cluster", max(workers), bound=True) as cluster:
                cluster.wait_for_workers(max(workers))
                killer = _Killer(cluster, kills)
                far, far_s, handed = _far(before, cluster, place, progress=killer.progress)
            digests.add(far.digest)
            figures["kills"] = killer.killed
            figures["killed_s"] = round(far_s, 1)
            figures["handed_out_again"] = handed - before.chunks
    figures["same_bytes"] = len(digests) == 1
    if len(workers) > 1:
        small, large = workers[0], workers[-1]
        figures["speed_up"] = round(figures[f"dask_{small}_s"] / figures[f"dask_{large}_s"], 2)
    return figures


class _Before:
    """The stages before the templates, made once."""

    def __init__(
        self,
        work: Path,
        config: BuildConfig,
        threads: Executor,
        processes: Executor,
        mesh: Path,
        trajectory: Path | None,
    ) -> None:
        self._config = config
        self._threads = threads
        self._cache = StageCache(work)  # keeps what it gave on the disk
        stages = BuildStages(
            self._cache,
            ChunkCache(self._cache, LocalExecutor(work, threads, processes)),
            lambda stage, fraction: None,
            lambda: False,
            config,
            threads,
        )
        read = stages.read_map(mesh, trajectory)
        self._mesh = stages.reconstruct_mesh(read)
        self._viewpoints = stages.sample_viewpoints(read, self._mesh)
        self._engine = engine_of(stages.fit_engine(read, self._viewpoints))
        self.chunks = 0

    def templates(
        self,
        work: Path,
        executor_in: Callable[[Path], ChunkExecutor],
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> tuple[StageResult, float]:
        """The stage in an empty folder, and the seconds that it took."""
        began = time.monotonic()
        told = 0

        def tell(stage: str, fraction: float) -> None:
            nonlocal told
            if fraction > 0:
                told += 1
                progress(fraction)

        cache = StageCache(work)
        chunks = ChunkCache(cache, executor_in(work))
        stages = BuildStages(cache, chunks, tell, lambda: False, self._config, self._threads)
        made = stages.make_templates(self._mesh, self._viewpoints, self._engine)
        self.chunks = self.chunks or told - 1  # the last word is the stage's
        return made, time.monotonic() - began


def _far(
    before: _Before,
    cluster: DaskCluster,
    place: Path,
    *,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[StageResult, float, int]:
    """The stage by the cluster, its seconds, and how often a chunk was handed out."""
    with DaskExecutor(cluster.address, str(place / "store")) as executor:
        made, seconds = before.templates(place / "work", lambda work: executor, progress)
    return made, seconds, _handed_out(cluster)


def _handed_out(cluster: DaskCluster) -> int:
    """By the scheduler's own record."""
    from distributed import Client

    def count(dask_scheduler: Any) -> int:
        return sum(entry[2] == "processing" for entry in dask_scheduler.transition_log)

    with Client(cluster.address, set_as_default=False) as client:
        return int(client.run_on_scheduler(count))


class _Killer:
    """Kills a worker at even steps of the progress, and starts another in its place."""

    def __init__(self, cluster: DaskCluster, kills: int) -> None:
        self._cluster = cluster
        self._at = [(i + 1) / (kills + 1) for i in range(kills)]
        self._lock = threading.Lock()
        self.killed = 0

    def progress(self, fraction: float) -> None:
        with self._lock:
            if self._at and fraction >= self._at[0]:
                self._at.pop(0)
                self._cluster.kill_worker(self._cluster.workers[0])
                self._cluster.start_worker(processor=self.killed % (os.cpu_count() or 1))
                self.killed += 1


def _floor_m2(folder: Path, config: dict[str, Any], files: Any) -> float:
    """Floor area that a coarse sampling of the world finds."""
    from firstfix_builder.read_map import read_trajectory
    from firstfix_builder.viewpoints.sample import sample_viewpoints

    parsed = BuildConfig.parse({**config, "viewpoints": {"spacing_m": 1.0}})
    poses = None if files.trajectory is None else read_trajectory(files.trajectory)
    mount_height_m = parsed.sensor_model.mount_height_m
    found = sample_viewpoints(files.simulator(), parsed.viewpoints, mount_height_m, poses)
    return float(len(found))


def _new(name: str) -> str:
    """A folder of this run's own."""
    return f"{name}-{os.getpid()}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.dask_builds", description=__doc__.split("\n")[0])
    parser.add_argument("--world", default="campus", choices=["campus", "factory", "office"])
    parser.add_argument("--templates", type=int, default=108_000, metavar="N", help="about so many")
    parser.add_argument("--rays", type=int, default=16_384, metavar="N", help="of a template, at most")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], metavar="N", help="clusters' sizes")
    parser.add_argument("--kills", type=int, default=2, metavar="N", help="of workers, in a last run")
    parser.add_argument("--work", type=Path, metavar="DIR", help="kept; default: a temporary folder")
    parser.add_argument("--quick", action="store_true", help="the factory, 3000 templates")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args()
    world, templates = ("factory", 3000) if chosen.quick else (chosen.world, chosen.templates)
    with tempfile.TemporaryDirectory() as scratch:
        figures = dask_builds(
            chosen.work or Path(scratch),
            world=world,
            templates=templates,
            rays=chosen.rays,
            workers=tuple(chosen.workers),
            kills=chosen.kills,
        )
    text = json.dumps(figures, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")


if __name__ == "__main__":
    main()
