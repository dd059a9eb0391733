"""A sandbox that is started before there is a job."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from firstfix.builds.options import WHEN_TOLD, BuildOptions, ExitCode
from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_builder.job.build_job import BuildJob
from firstfix_builder.sandbox.prepared import PreparedSandbox
from firstfix_builder.sandbox.process import too_many_processes
from firstfix_builder.sandbox.sandboxed_build import SandboxedBuild
from tests.builder.fixtures import queue_build
from tests.builder.sandbox.test_sandbox import PROGRAM, config_telling
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow


def options_in(tmp_path: Path) -> BuildOptions:
    (tmp_path / "store").mkdir(exist_ok=True)
    return BuildOptions(build_id="b1", work=tmp_path / "work", store=str(tmp_path / "store"))


def job_in(work: Path) -> BuildJob:
    source = work / "sources" / "hall.ply"
    source.parent.mkdir(parents=True, exist_ok=True)
    source.write_bytes(b"a cloud")
    return BuildJob(source, None, config_telling(do="succeed"), work, lambda *_: None, lambda: False)


def test_the_job_goes_to_the_sandbox_that_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    build = SandboxedBuild(options_in(tmp_path), program=PROGRAM)
    build.prepare()
    monkeypatch.setattr(PreparedSandbox, "start", lambda *_, **__: pytest.fail("another one is started"))
    built = build.build_version(job_in(tmp_path / "work"))
    assert (built.directory / "index.bin").read_bytes() == b"a cloud"
    assert not (tmp_path / "work" / "build" / "tmp").exists()


def test_one_whose_folders_were_made_anew_is_replaced(tmp_path: Path):
    build = SandboxedBuild(options_in(tmp_path), program=PROGRAM)
    build.prepare()
    shutil.rmtree(tmp_path / "work")
    built = build.build_version(job_in(tmp_path / "work"))
    assert (built.directory / "index.bin").read_bytes() == b"a cloud"


def test_one_that_is_not_used_is_ended(tmp_path: Path):
    build = SandboxedBuild(options_in(tmp_path), program=PROGRAM)
    build.prepare()
    prepared = build._prepared
    assert prepared is not None
    build.close()
    assert prepared.process.returncode is not None
    assert not prepared.is_usable
    assert not too_many_processes(prepared.process.pid)


def test_the_worker_waits_for_the_id_of_a_build(tmp_path: Path):
    store = Store.open(str(tmp_path / "store"))
    queue_build(Catalog(store), tmp_path, config={"sensor": "no-such-lidar"})

    def told(words: bytes) -> int:
        command = [sys.executable, "-m", "firstfix_builder.worker", "--store", str(tmp_path / "store")]
        arguments = ["--work", str(tmp_path / "work"), "--build", WHEN_TOLD, "--tied-to-stdin"]
        with subprocess.Popen([*command, *arguments], stdin=subprocess.PIPE) as process:
            assert process.stdin is not None
            os.write(process.stdin.fileno(), words)
            if not words:
                wait_until(lambda: any((tmp_path / "work" / "build" / "tmp").glob("*")))
                process.stdin.close()
            return process.wait(LIMIT_S)

    assert told(b"b1\n") == ExitCode.FAILED
    assert "no-such-lidar" in Catalog(store).builds.status("b1")["error"]["detail"]
    assert told(b"b9\n") == ExitCode.USAGE
    assert told(b"") == ExitCode.SUCCEEDED  # the service is gone
    assert not (tmp_path / "work" / "build" / "tmp").exists()
