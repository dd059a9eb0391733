"""A build worker with everything of the real one but its work: stages that sleep, and a small version.

    FIRSTFIX_BUILD_COMMAND='["python", "-m", "tests.tiny_worker"]'

What it does is what ``config_telling`` was told: ``stage_s`` seconds a stage, ``hang_in`` a stage until the
file ``until`` exists (with ``deaf`` also if it is cancelled), ``die_in`` a stage, ``fail_in`` one,
``fill_in`` one the disk of its work folder, ``grow_in`` one its memory. ``file_bytes`` is the size of each
file of the version. With ``early`` it publishes a provisional version after the first stage. Each stage that
is made leaves a line in ``made.txt`` of the work folder.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import time
from functools import partial
from pathlib import Path
from typing import Any

from firstfix.builds.options import BuildOptions, ExitCode
from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.manifest import Manifest
from firstfix.errors import BuildCancelled, BuildFailed, OutOfSpace, StoreUnavailable
from firstfix.store.store import Store
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.job.build_job import BuildJob, BuildResult
from firstfix_builder.job.run_build import run_build

STAGES = ("read", "mesh", "describe", "cluster", "index")
FILES = 4
FILE_BYTES = 1_000_000


def config_telling(**told: Any) -> dict[str, Any]:
    """A build config that the service takes for a real one: what is told stands in the sensor's name."""
    return {"sensor": {"preset": "vlp-16", "name": json.dumps(told)}}


def build_version(job: BuildJob, shared: SharedStages | None = None) -> BuildResult:
    """Makes a version whose bytes depend on the source and the config alone."""
    told = json.loads(job.config["sensor"]["name"]) if job.config else {}
    seed = hashlib.sha256(job.source.read_bytes() + str(told.get("seed")).encode()).hexdigest()
    cache = StageCache(job.work, shared=shared, code_version="tiny")

    def make(stage: str, out: Path) -> None:
        with (job.work / "made.txt").open("a") as file:
            file.write(f"{stage}\n")
        end = time.monotonic() + float(told.get("stage_s", 0.0))
        while time.monotonic() < end or (told.get("hang_in") == stage and not Path(told["until"]).exists()):
            if job.cancelled() and not told.get("deaf"):
                raise BuildCancelled("seen")
            time.sleep(0.02)
        if told.get("die_in") == stage:
            os.kill(os.getpid(), signal.SIGKILL)
        if told.get("fail_in") == stage:
            raise BuildFailed("as told")
        if told.get("grow_in") == stage:
            _grow()
        if told.get("fill_in") == stage:
            _fill(out)
        file_bytes = int(told.get("file_bytes", FILE_BYTES))
        for i in range(FILES):
            block = hashlib.sha256(f"{seed}{stage}{i}".encode()).digest()
            (out / f"{stage}{i}.bin").write_bytes(block * (file_bytes // len(block)))

    def publish_early() -> None:
        folder = job.work / "early"
        folder.mkdir(exist_ok=True)
        (folder / "a.bin").write_bytes(seed.encode())
        assert job.publish_provisional is not None
        job.publish_provisional(
            BuildResult(folder, Manifest.for_directory(folder, config={"seed": seed}, provisional=True))
        )

    result = None
    for stage in STAGES:
        if stage == STAGES[1] and told.get("early") and job.publish_provisional is not None:
            job.progress("provisional", 0.0)
            publish_early()
        job.progress(stage, 0.0)
        result = cache.run(stage, {"seed": seed}, {}, lambda out, stage=stage: make(stage, out))
    assert result is not None
    return BuildResult(result.directory, Manifest.for_directory(result.directory, config={"seed": seed}))


def _grow() -> None:
    """Takes memory until it is ended for it."""
    kept = []
    while True:
        kept.append(b"x" * (16 << 20))
        time.sleep(0.02)


def _fill(out: Path) -> None:
    """Writes until the disk is full."""
    with (out / "ballast").open("wb") as file:
        while True:
            file.write(bytes(1 << 20))
            file.flush()


def main() -> int:
    options = BuildOptions.from_arguments()
    shared = SharedStages(Store.open(options.store)) if options.share_stages else None
    try:
        return run_build(options, partial(build_version, shared=shared), STAGES, own_process=True)
    except StoreUnavailable:
        return ExitCode.TRY_AGAIN
    except OutOfSpace:
        return ExitCode.NO_SPACE


if __name__ == "__main__":
    raise SystemExit(main())
