"""Runs one build: fetches the source, builds the version, publishes it and records the result."""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path

from firstfix.builds.config import ActivateConfig, PatchMode, SelfTestConfig
from firstfix.builds.options import (
    FETCH_SOURCE,
    PUBLISH,
    STAGES,
    BuildOptions,
    ExitCode,
    reported_stages,
)
from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.catalog.version_findings import findings_of
from firstfix.errors import (
    BuildCancelled,
    ClusterUnavailable,
    OutOfSpace,
    StoreError,
    StoreUnavailable,
)
from firstfix.maintenance.build_end import end_build
from firstfix.store.store import Store

from ..execution.build_trace import BuildTrace
from .base_source import collect_base, with_base
from .build_job import BuildJob, BuildResult, BuildVersion, error_record, full_disk_named
from .confirmed_queries import collect_confirmed
from .fetch_source import SourceFetch, json_object
from .patch_source import collect_patch_source
from .provenance import provenance_of_request
from .reporter import BuildReporter

_EXIT_OF_STATE = {
    "succeeded": ExitCode.SUCCEEDED,
    "failed": ExitCode.FAILED,
    "cancelled": ExitCode.CANCELLED,
}
_log = logging.getLogger(__name__)


def run_build(
    options: BuildOptions,
    build_version: BuildVersion,
    stages: Sequence[str] = STAGES,
    *,
    own_process: bool = False,
) -> ExitCode:
    """Run a build to its end and records the result. A build that has already ended stays as it is.

    Builds that share a work folder run one after the other.

    Args:
        stages: names that ``build_version`` reports.
        own_process: see ``BuildReporter``.

    Returns:
        The exit code of the process.

    Raises:
        NotFound: no such build.
        StoreUnavailable: the recorded status may be out of date.
        ClusterUnavailable: the machines that run the build's chunks are gone.
        OutOfSpace: the store or the disk of the work folder is full.
    """
    build_id, work = options.build_id, options.work
    catalog = Catalog(Store.open(options.store))
    request = catalog.builds.request(build_id)
    map_id = str(request.get("map_id", ""))
    with _alone_in(work), BuildTrace(build_id, map_id, request.get("traceparent")) as trace:
        state = catalog.builds.status(build_id)["state"]
        if state in _EXIT_OF_STATE:
            return _EXIT_OF_STATE[state]
        config = json_object(request, "config")
        is_wanted = options.provisional and config.get("provisional") is not False
        is_early = is_wanted and not catalog.state(map_id).has_full
        all_stages = reported_stages(stages, provisional=is_early)
        with BuildReporter(catalog, options, map_id, all_stages, trace, own_process=own_process) as reporter:

            def tick(stage: str, fraction: float) -> None:
                trace.tick(stage)
                reporter.tick(stage, fraction)

            def publish_provisional(built: BuildResult) -> None:
                if reporter.is_cancelled():
                    raise BuildCancelled("cancelled before the provisional version was published")
                if catalog.reason_to_hold(map_id, built.manifest, ActivateConfig()) is not None:
                    return  # the full version's status will say why
                version = catalog.publish(
                    map_id, built.directory, built.manifest, build_id=build_id, provenance=provenance
                )
                if version in catalog.state(map_id).provisional:
                    reporter.provisional_version = version
                    _log.info("build %s has published the provisional version %s", build_id, version)

            tick(FETCH_SOURCE, 0.0)
            try:
                with full_disk_named(work):
                    catalog.store.probe()
                    fetch = SourceFetch(options, catalog.store, map_id)
                    sources = fetch.of_request(request, partial(tick, FETCH_SOURCE))
                    provenance = provenance_of_request(request, sources["source"])
                    recorded_queries = RecordedQueries(Store.open(options.recorded_store or options.store))
                    patch = json_object(request, "patch")
                    if patch:
                        folder = work / "sources" / "patch"
                        collected = collect_patch_source(
                            catalog,
                            recorded_queries,
                            map_id,
                            str(patch["base"]),
                            sources,
                            folder,
                            partial(tick, FETCH_SOURCE),
                        )
                        sources = {"source": collected}
                        config = {**config, "base": None}
                    else:
                        config = with_base(catalog, map_id, config)
                    job = BuildJob(
                        sources["source"],
                        sources.get("trajectory"),
                        config,
                        work,
                        tick,
                        reporter.is_cancelled,
                        publish_provisional if is_early else None,
                        collect_confirmed(
                            recorded_queries,
                            map_id,
                            SelfTestConfig.model_validate(config.get("self_test") or {}).confirmed,
                            work / "sources" / "confirmed",
                        ),
                        collect_base(catalog, map_id, config, work / "sources" / "base"),
                    )
                    built = build_version(job)
                    if reporter.is_cancelled():
                        raise BuildCancelled("cancelled before it was published")
                    tick(PUBLISH, 0.0)
                    activate = ActivateConfig.model_validate(config.get("activate") or {})
                    mode: PatchMode = "activate" if patch.get("mode") == "activate" else "propose"
                    held = catalog.reason_to_hold(map_id, built.manifest, activate, mode)
                    version = catalog.publish(
                        map_id,
                        built.directory,
                        built.manifest,
                        activate=held is None,
                        build_id=build_id,
                        provenance=provenance,
                        on_progress=partial(tick, PUBLISH),
                    )
                status = new_status(
                    "succeeded",
                    map_id=map_id,
                    stage=PUBLISH,
                    progress=1.0,
                    version=version,
                    activated=held is None,
                    findings=[one.to_mapping() for one in [*findings_of(built.manifest), held] if one],
                )
                if held is not None:
                    _log.warning("build %s: %s", build_id, held.text)
                    if reporter.provisional_version is not None:
                        taken_back = reporter.provisional_version[:12]
                        _log.warning("map %s: its provisional version %s answers no more", map_id, taken_back)
            except (StoreUnavailable, ClusterUnavailable, OutOfSpace) as error:
                reporter.stop()
                with suppress(StoreError):  # not the build's fault: it is to be run again
                    catalog.builds.set_status(build_id, reporter.waiting_status(error_record(error, work)))
                raise
            except BuildCancelled:
                status = new_status("cancelled", map_id=map_id, stage=reporter.stage)
            except Exception as error:
                _log.exception("build %s failed in %s", build_id, reporter.stage)
                status = new_status(
                    "failed", map_id=map_id, stage=reporter.stage, error=error_record(error, work)
                )
        status["provisional_version"] = reporter.provisional_version
        trace.end(status["state"], (status["error"] or {}).get("code"))
        catalog.builds.set_stages(build_id, [asdict(stage) for stage in trace.stages])
        if status["state"] == "succeeded":
            catalog.builds.set_status(build_id, status)
        else:
            end_build(catalog, build_id, status)
        _remove_sources(work / "sources")
        return _EXIT_OF_STATE[status["state"]]


def _remove_sources(folder: Path) -> None:
    """Remove what is in the folder. It stays itself: a sandbox that waits for the next build may read it."""
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


@contextmanager
def _alone_in(work: Path) -> Iterator[None]:
    """Lock the work folder, because two builds would write their versions to the same place."""
    work.mkdir(parents=True, exist_ok=True)
    handle = os.open(work / "worker.lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
