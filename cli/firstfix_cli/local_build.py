"""Builds that this machine, or a cluster, runs and publishes into a store."""

from __future__ import annotations

import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

from firstfix.builds.config import BuildConfig
from firstfix.builds.options import PUBLISH, BuildOptions
from firstfix.builds.shared_stages import collect_stages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.catalog.version_findings import findings_of
from firstfix.store.store import Store

from .read_confined import read_confined
from .stage_bars import Progress

CLUSTER_STAGES_S = 7 * 86400.0  # how long the inputs of a cluster's workers stay in the store


def local_build(
    source: Path,
    map_id: str,
    config: dict[str, Any],
    trajectory: Path | None,
    options: BuildOptions,
    progress: Progress,
) -> dict[str, Any]:
    """Build a map and publish the version. Returns facts about it, as ``remote_build`` does.

    Args:
        config: the given values, as of ``BuildConfig``.
        progress: opens a display of the stages' progress.

    Raises:
        BuildFailed: the build ended without a version.
    """
    # Not at the top: the service's image has this module, and none of the packages that builds need.
    from firstfix_builder.execution.build_trace import BuildTrace
    from firstfix_builder.execution.dask_executor import check_reachable
    from firstfix_builder.job.build_job import BuildJob
    from firstfix_builder.job.confirmed_queries import collect_confirmed
    from firstfix_builder.pipeline import CONFIRMED, build_version

    settings = BuildConfig.parse(config)
    if options.scheduler is not None:
        check_reachable(options.store)
    store = Store.open(options.store)
    store.probe()  # before the work, not after it
    with progress() as show, BuildTrace("", map_id, None) as trace:

        def tell(stage: str, fraction: float) -> None:
            trace.tick(stage)
            show(stage, fraction)

        recorded_queries, kept = RecordedQueries(store), options.work / "confirmed"
        confirmed = collect_confirmed(recorded_queries, map_id, settings.self_test.confirmed, kept)
        job = BuildJob(source, trajectory, config, options.work, tell, lambda: False, confirmed=confirmed)
        try:
            read_confined(job, options)
            built = build_version(
                source,
                settings,
                options.work / "build",
                trajectory=trajectory,
                confirmed=confirmed,
                progress=tell,
                options=options,
            )
        finally:  # scans of robots, however the build ends
            for folder in (kept, options.work / "build" / CONFIRMED):
                shutil.rmtree(folder, ignore_errors=True)
        tell(PUBLISH, 0.0)
        catalog, manifest = Catalog(store), built.manifest
        held = catalog.reason_to_hold(map_id, manifest, settings.activate)
        version = catalog.publish(map_id, built.directory, manifest, activate=held is None)
        tell(PUBLISH, 1.0)
        trace.end("succeeded")
    if options.scheduler is not None:  # there is no service that does it
        collect_stages(store, CLUSTER_STAGES_S)
    return {
        "map_id": map_id,
        "version": version,
        "counts": dict(manifest.counts),
        "bytes": manifest.total_bytes,
        "self_test": dict(manifest.self_test),
        "activated": held is None,
        "findings": [one.to_mapping() for one in [*findings_of(manifest), held] if one is not None],
        "stages": [asdict(stage) for stage in trace.stages],
    }
