"""Runs one build from an object store to an object store, in a process of its own.

    python -m firstfix_builder.worker --store URL --build ID --work DIR

Ending at any moment, kill -9 included, costs only the stage under way: run again with the same folder
it goes on, and what was published or recorded by then stays true. Exit codes: 0 succeeded, 1 failed
(the status says why), 2 usage, 3 cancelled, 75 stopped or the store is out of reach: run it again.
"""

from __future__ import annotations

import argparse
import fcntl
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from firstfix.builds.records import new_status
from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.errors import (
    BuildCancelled,
    ClusterUnavailable,
    InvalidOption,
    NotFound,
    StoreError,
    StoreUnavailable,
)
from firstfix.store.store import Store

from .execution.build_trace import BuildTrace
from .execution.executor_url import THREADS, dask_address
from .execution.stage_names import STAGES
from .job.fetch_source import DEFAULT_MAX_BYTES, SourcePolicy, fetch_source
from .job.log import set_up_build_log
from .job.reporter import EXIT_CANCELLED, EXIT_TRY_AGAIN, BuildReporter
from .sandbox.failures import described
from .sandbox.sandboxed_build import SandboxedBuild

EXIT_SUCCEEDED, EXIT_FAILED, EXIT_USAGE = 0, 1, 2
_EXIT_OF_STATE = {"succeeded": EXIT_SUCCEEDED, "failed": EXIT_FAILED, "cancelled": EXIT_CANCELLED}
# The service that runs a worker sets them; they are its own settings' names.
LOG_LEVEL_VARIABLE, LOG_JSON_VARIABLE = "FIRSTFIX_LOG_LEVEL", "FIRSTFIX_LOG_JSON"
SANDBOX_VARIABLE, MAX_MEMORY_VARIABLE = "FIRSTFIX_BUILD_SANDBOX", "FIRSTFIX_BUILD_MAX_MEMORY_BYTES"
_log = logging.getLogger(__name__)


class Built(Protocol):
    """What a pipeline gives: ``firstfix_builder.pipeline.BuiltVersion``."""

    @property
    def directory(self) -> Path: ...

    @property
    def manifest(self) -> Manifest: ...


class BuildVersion(Protocol):
    """The pipeline's entry: ``firstfix_builder.pipeline.build_version`` with the config as JSON."""

    def __call__(
        self,
        source: Path,
        config: dict[str, Any],
        work: Path,
        *,
        trajectory: Path | None,
        progress: Callable[[str, float], None],
        cancelled: Callable[[], bool],
    ) -> Built: ...


def run_build(
    store_url: str,
    build_id: str,
    work: Path,
    build_version: BuildVersion,
    stages: Sequence[str],
    *,
    policy: SourcePolicy | None = None,
    own_process: bool = False,
    tied_to_stdin: bool = False,
) -> int:
    """Runs the build to its end and records how it ended; a build that has ended is left alone.

    Args:
        work: holds sources and the stage cache; builds that share it run one after the other.
        stages: names that ``build_version`` reports.
        own_process, tied_to_stdin: see ``BuildReporter``.

    Returns:
        the process's exit code.

    Raises:
        NotFound: no such build.
        StoreUnavailable: the status may be stale.
        ClusterUnavailable: those who do its work are gone.
    """
    catalog = Catalog(Store.open(store_url))
    request = catalog.build_request(build_id)
    map_id = str(request.get("map_id", ""))
    with _alone_in(work), BuildTrace(build_id, map_id, request.get("traceparent")) as trace:
        state = catalog.build_status(build_id)["state"]
        if state in _EXIT_OF_STATE:
            return _EXIT_OF_STATE[state]
        all_stages = ("fetch_source", *stages, "publish")
        with BuildReporter(
            catalog, build_id, map_id, all_stages, own_process=own_process, tied_to_stdin=tied_to_stdin
        ) as reporter:

            def tick(stage: str, fraction: float) -> None:
                reporter.tick(stage, fraction)
                trace.tick(stage)

            tick(all_stages[0], 0.0)
            try:
                catalog.store.probe()
                told = partial(tick, all_stages[0])
                sources = _fetch_all(store_url, catalog, build_id, request, work / "sources", policy, told)
                built = build_version(
                    sources["source"],
                    _mapping(request, "config"),
                    work,
                    trajectory=sources.get("trajectory"),
                    progress=tick,
                    cancelled=reporter.is_cancelled,
                )
                if reporter.is_cancelled():
                    raise BuildCancelled("cancelled before it was published")
                tick("publish", 0.0)
                version = catalog.publish(
                    map_id,
                    built.directory,
                    built.manifest,
                    build_id=build_id,
                    on_progress=partial(tick, "publish"),
                )
                status = new_status(
                    "succeeded", map_id=map_id, stage="publish", progress=1.0, version=version
                )
            except (StoreUnavailable, ClusterUnavailable):
                with suppress(StoreError):  # not the build's fault: it is to be run again
                    catalog.set_build_status(build_id, new_status("queued", map_id=map_id))
                raise
            except BuildCancelled:
                status = new_status("cancelled", map_id=map_id, stage=reporter.stage)
            except Exception as error:
                _log.exception("build %s failed in %s", build_id, reporter.stage)
                status = new_status(
                    "failed", map_id=map_id, stage=reporter.stage, error=described(error, work)
                )
        trace.end(status["state"], (status["error"] or {}).get("code"))
        catalog.set_build_stages(build_id, [asdict(stage) for stage in trace.stages])
        catalog.set_build_status(build_id, status)
        shutil.rmtree(work / "sources", ignore_errors=True)
        return _EXIT_OF_STATE[status["state"]]


def _fetch_all(
    store_url: str,
    catalog: Catalog,
    build_id: str,
    request: Mapping[str, Any],
    folder: Path,
    policy: SourcePolicy | None,
    told: Callable[[float], None],
) -> dict[str, Path]:
    """Local files of the source, and of the trajectory if the request has one."""
    map_id = str(request.get("map_id", ""))
    source, trajectory = _mapping(request, "source"), _mapping(request, "trajectory")
    named = {"source": (source, str(request.get("file_name") or _ending_of(source)))}
    if trajectory:
        named["trajectory"] = (trajectory, str(trajectory.get("file_name") or _ending_of(trajectory)))
    return {
        role: fetch_source(
            store_url,
            catalog.store,
            map_id,
            build_id,
            where,
            file_name,
            folder,
            policy,
            _share(told, number, len(named)),
        )
        for number, (role, (where, file_name)) in enumerate(named.items())
    }


def _share(told: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    """Progress of one of several files, as a share of them all."""
    return lambda done: told((number + done) / count)


def _ending_of(named: Mapping[str, Any]) -> str:
    """A file name for what was named by URL only."""
    return urlsplit(str(named.get("url", ""))).path.rsplit("/", 1)[-1]


def _mapping(request: Mapping[str, Any], name: str) -> dict[str, Any]:
    value = request.get(name) or {}
    if not isinstance(value, dict):
        raise InvalidOption(f"{name} of the request is no JSON object")
    return value


@contextmanager
def _alone_in(work: Path) -> Iterator[None]:
    """Waits until no other build uses the folder: a pipeline's version stands at one place in it."""
    work.mkdir(parents=True, exist_ok=True)
    handle = os.open(work / "worker.lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _build_here(
    source: Path,
    config: dict[str, Any],
    work: Path,
    *,
    scheduler: str | None,
    store_url: str,
    sandbox: SandboxedBuild | None,
    **hooks: Any,
) -> Built:
    """In this process, which has the store and the network that a cluster needs. With a sandbox it parses
    nothing of a stranger's: that is in the stage cache when it begins."""
    from firstfix.builds.config import BuildConfig

    from .pipeline import Cluster, build_version

    if sandbox is not None:
        told = {name: hooks[name] for name in ("trajectory", "progress", "cancelled")}
        sandbox.read_source(source, config, **told)
    cluster = None if scheduler is None else Cluster(scheduler, store_url)
    return build_version(source, BuildConfig.parse(config), work / "build", cluster=cluster, **hooks)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="firstfix_builder.worker", description="Runs one build.")
    parser.add_argument("--store", required=True, metavar="URL", help="the store of maps and builds")
    parser.add_argument("--build", required=True, metavar="ID", help="the build to run")
    parser.add_argument("--work", required=True, type=Path, metavar="DIR", help="sources and stage cache")
    parser.add_argument(
        "--max-source-bytes", type=int, default=DEFAULT_MAX_BYTES, metavar="N", help="of one source file"
    )
    parser.add_argument(
        "--source-root",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="sources may be file:// URLs below it; may be repeated",
    )
    parser.add_argument(
        "--share-stages",
        action="store_true",
        help="finished stages are fetched from the store, and put there",
    )
    parser.add_argument(
        "--tied-to-stdin", action="store_true", help="stop as on SIGTERM when standard input ends"
    )
    parser.add_argument(
        "--source-url",
        action="append",
        default=[],
        metavar="PREFIX",
        help="sources may be http or https URLs below it; may be repeated",
    )
    parser.add_argument(
        "--executor", default=THREADS, metavar="URL", help="threads, dask://HOST:PORT or dask+tls://HOST:PORT"
    )
    parser.add_argument(
        "--sandbox",
        choices=("auto", "required", "off"),
        default=os.environ.get(SANDBOX_VARIABLE, "auto"),
        help="auto: as far as the kernel has the means; required: or no build is run",
    )
    chosen = parser.parse_args(arguments)
    log_level = os.environ.get(LOG_LEVEL_VARIABLE, "info")
    log_json = os.environ.get(LOG_JSON_VARIABLE) == "true"
    set_up_build_log(chosen.build, level=log_level, as_json=log_json)
    max_memory = os.environ.get(MAX_MEMORY_VARIABLE)
    try:
        shared = SharedStages(Store.open(chosen.store)) if chosen.share_stages else None
        scheduler = dask_address(chosen.executor)
        sandbox = None
        if chosen.sandbox != "off":
            sandbox = SandboxedBuild(
                chosen.work,
                chosen.build,
                required=chosen.sandbox == "required",
                shared=shared,
                max_memory_bytes=None if max_memory is None else int(max_memory),
                log_level=log_level,
                log_json=log_json,
            )
        if sandbox is not None and scheduler is None:
            build_version: BuildVersion = sandbox.build_version
        else:
            options = {
                "scheduler": scheduler,
                "store_url": chosen.store,
                "sandbox": sandbox,
                "shared": shared,
            }
            build_version = partial(_build_here, **options)
        return run_build(
            chosen.store,
            chosen.build,
            chosen.work,
            build_version,
            STAGES,
            policy=SourcePolicy(chosen.max_source_bytes, tuple(chosen.source_root), tuple(chosen.source_url)),
            own_process=True,
            tied_to_stdin=chosen.tied_to_stdin,
        )
    except (StoreUnavailable, ClusterUnavailable) as error:
        _log.error("build %s: %s", chosen.build, error)
        return EXIT_TRY_AGAIN
    except (InvalidOption, NotFound, StoreError) as error:
        _log.error("build %s: %s", chosen.build, error)
        return EXIT_USAGE


if __name__ == "__main__":
    raise SystemExit(main())
