"""Builds that this machine, or a cluster, runs and publishes into a store."""

from __future__ import annotations

import getpass
import os
import shlex
import shutil
import socket
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import firstfix
from firstfix.builds.config import BuildConfig
from firstfix.builds.options import PUBLISH, BuildOptions
from firstfix.builds.shared_stages import collect_stages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.provenance import Provenance
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.catalog.version_findings import findings_of
from firstfix.errors import NotFound
from firstfix.store.sha256 import sha256_of
from firstfix.store.store import Store

from .read_confined import read_confined
from .stage_bars import Progress

CLUSTER_STAGES_S = 7 * 86400.0  # how long the inputs of a cluster's workers stay in the store


def made_of(source: Path, trajectory: Path | None, note: str) -> Provenance:
    """Provenance of what this process makes of a file or folder.

    Raises:
        NotFound: it is not there.
    """
    if not source.exists():
        raise NotFound(f"{source}: no such file")
    files = [path for path in source.rglob("*") if path.is_file()] if source.is_dir() else [source]
    return Provenance(
        file_name=source.absolute().name,
        size_bytes=sum(path.stat().st_size for path in files),
        sha256="" if source.is_dir() else sha256_of(source),
        trajectory="" if trajectory is None else trajectory.name,
        note=note,
        release=firstfix.__version__,
        caller=f"user:{_user()}",
        host=socket.gethostname(),
        command=shlex.join(["firstfix", *sys.argv[1:]]),
    )


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user may have a number alone
        return str(os.getuid())


def local_build(
    source: Path,
    map_id: str,
    config: dict[str, Any],
    trajectory: Path | None,
    options: BuildOptions,
    progress: Progress,
    provenance: Provenance,
) -> dict[str, Any]:
    """Build a map and publish the version. Returns facts about it, as ``remote_build`` does.

    Args:
        config: the given values, as of ``BuildConfig``. Where little has changed since the map's active
            version, learned keys and calibration are kept, unless it is ``exact``.
        progress: opens a display of the stages' progress.

    Raises:
        BuildFailed: the build ended without a version.
    """
    # Not at the top: the service's image has this module, and none of the packages that builds need.
    from firstfix_builder.execution.build_trace import BuildTrace
    from firstfix_builder.execution.dask_executor import check_reachable
    from firstfix_builder.job.base_source import collect_base, with_base
    from firstfix_builder.job.build_job import BuildJob
    from firstfix_builder.job.confirmed_queries import collect_confirmed
    from firstfix_builder.pipeline import CONFIRMED, build_version

    BuildConfig.parse(config)
    if options.scheduler is not None:
        check_reachable(options.store)
    store = Store.open(options.store)
    store.probe()  # before the work, not after it
    catalog = Catalog(store)
    config = with_base(catalog, map_id, config)
    settings = BuildConfig.parse(config)
    with progress() as show, BuildTrace("", map_id, None) as trace:

        def tell(stage: str, fraction: float) -> None:
            trace.tick(stage)
            show(stage, fraction)

        recorded_queries, kept = RecordedQueries(store), options.work / "confirmed"
        base = collect_base(catalog, map_id, config, options.work / "base")
        confirmed = collect_confirmed(recorded_queries, map_id, settings.self_test.confirmed, kept)
        job = BuildJob(source, trajectory, config, options.work, tell, lambda: False, confirmed=confirmed)
        try:
            read_confined(job, options)
            trace.settle()
            built = build_version(
                source,
                settings,
                options.work / "build",
                trajectory=trajectory,
                confirmed=confirmed,
                base=base,
                progress=tell,
                options=options,
            )
        finally:  # scans of robots, however the build ends
            for folder in (kept, options.work / "base", options.work / "build" / CONFIRMED):
                shutil.rmtree(folder, ignore_errors=True)
        tell(PUBLISH, 0.0)
        manifest = built.manifest
        held = catalog.reason_to_hold(map_id, manifest, settings.activate)
        version = catalog.publish(
            map_id, built.directory, manifest, activate=held is None, provenance=provenance
        )
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
        "rebuilt": manifest.source.get("rebuilt"),
        "findings": [one.to_mapping() for one in [*findings_of(manifest), held] if one is not None],
        "stages": [asdict(stage) for stage in trace.stages],
    }
