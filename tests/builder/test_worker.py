"""The worker's orchestration, with a tiny pipeline in place of the real one."""

from __future__ import annotations

import errno
import hashlib
import itertools
import re
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import firstfix
from firstfix.builds.options import BuildOptions
from firstfix.builds.records import BuildRecords, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.errors import (
    BuildCancelled,
    BuildFailed,
    ClusterUnavailable,
    NotFound,
    OutOfSpace,
    StoreUnavailable,
    TooLarge,
    UnreadableRecord,
)
from firstfix.store.store import Store
from firstfix_builder.job import reporter as build_reporter
from firstfix_builder.job.build_job import MEMORY_REACHED, BuildJob, BuildResult
from firstfix_builder.job.reporter import BuildReporter
from firstfix_builder.job.run_build import run_build
from tests.builder.fixtures import queue_build, uploaded
from tests.waiting import LIMIT_S, let_pass, wait_until

STAGES = ("one", "two")


@dataclass
class TinyPipeline:
    """Its version is the source's bytes. ``act`` runs in the midst of it."""

    act: Callable[[Callable[[str, float], None], Callable[[], bool]], None] = lambda progress, cancelled: None
    calls: list[dict[str, Any]] = field(default_factory=list)

    def __call__(self, job: BuildJob) -> BuildResult:
        self.calls.append({"source": job.source.name, "trajectory": job.trajectory, "config": job.config})
        job.progress("one", 0.5)
        self.act(job.progress, job.cancelled)
        directory = job.work / "version"
        directory.mkdir(exist_ok=True)
        (directory / "index.bin").write_bytes(job.source.read_bytes())
        job.progress("two", 1.0)
        return BuildResult(directory, Manifest.for_directory(directory, config=job.config))


@dataclass(frozen=True)
class Place:
    """A store with one uploaded source and a build of it, ``b1``."""

    url: str
    catalog: Catalog
    work: Path

    def run(self, pipeline: TinyPipeline, build_id: str = "b1", **options: Any) -> int:
        run = BuildOptions(store=self.url, build_id=build_id, work=self.work, **options)
        return run_build(run, pipeline, STAGES)

    def request(self, build_id: str, **changes: Any) -> None:
        request = {**self.catalog.builds.request("b1"), **changes}
        self.catalog.builds.put(build_id, request)


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return make_place(f"file://{tmp_path}/store", tmp_path)


def make_place(url: str, tmp_path: Path) -> Place:
    catalog = Catalog(Store.open(url))
    queue_build(catalog, tmp_path, config={"x": 1})
    return Place(url, catalog, tmp_path / "work")


def test_a_build_is_published_and_its_end_recorded(place: Place) -> None:
    pipeline = TinyPipeline()
    assert place.run(pipeline) == 0
    status = place.catalog.builds.status("b1")
    version = place.catalog.active_version("hall")
    assert status == new_status("succeeded", map_id="hall", stage="publish", progress=1.0, version=version)
    assert place.catalog.log("hall")[0].build_id == "b1"
    (info,) = place.catalog.versions("hall")
    made = info.provenance
    assert (made.file_name, made.size_bytes, made.sha256) == (
        "hall.ply",
        7,
        hashlib.sha256(b"a cloud").hexdigest(),
    )
    assert (made.release, made.host) == (firstfix.__version__, socket.gethostname())
    assert pipeline.calls == [{"source": "hall.ply", "trajectory": None, "config": {"x": 1}}]
    folder = place.catalog.fetch_version("hall", str(version), place.work / "cache")
    assert (folder / "index.bin").read_bytes() == b"a cloud"
    assert not any((place.work / "sources").iterdir())  # uploads are large: they stay in the store only


def test_it_works_on_a_real_s3_server(s3_url: str, tmp_path: Path) -> None:
    place = make_place(s3_url, tmp_path)
    assert place.run(TinyPipeline()) == 0
    assert place.catalog.active_version("hall") == place.catalog.builds.status("b1")["version"]


def test_fetching_and_publishing_tell_their_progress(
    place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A build without progress is ended: a slow connection is not one that hangs."""
    poses = uploaded(place.catalog, b"1 2 3 4", tmp_path)
    place.request("b2", trajectory={**poses, "file_name": "poses.tum"})
    told: list[tuple[str, float]] = []
    tick = BuildReporter.tick

    def heard(reporter: BuildReporter, stage: str, fraction: float) -> None:
        told.append((stage, fraction))
        tick(reporter, stage, fraction)

    monkeypatch.setattr(BuildReporter, "tick", heard)
    monkeypatch.setattr("firstfix.store.store.CHUNK_BYTES", 4)
    assert place.run(TinyPipeline(), "b2") == 0
    fetched = [fraction for stage, fraction in told if stage == "fetch_source"]
    assert fetched == pytest.approx([0.0, 4 / 14, 7 / 14, 11 / 14, 1.0])
    assert [fraction for stage, fraction in told if stage == "publish"] == [0.0, 1.0]


def test_a_trajectory_comes_with_its_own_name(place: Place, tmp_path: Path) -> None:
    poses = uploaded(place.catalog, b"1 2 3", tmp_path)
    place.request("b2", trajectory={**poses, "file_name": "../../poses of hall.tum"})
    seen: list[bytes] = []

    class Reads(TinyPipeline):
        def __call__(self, job: BuildJob) -> BuildResult:
            assert job.trajectory is not None
            assert job.trajectory.name == "poses_of_hall.tum"
            assert job.trajectory.is_relative_to(place.work)
            seen.append(job.trajectory.read_bytes())
            return super().__call__(job)

    assert place.run(Reads(), "b2") == 0
    assert seen == [b"1 2 3"]


def test_the_status_is_written_twice_a_second_at_most(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[dict[str, Any]] = []
    original = BuildRecords.set_status

    def record(records: BuildRecords, build_id: str, status: dict[str, Any]) -> None:
        written.append(status)
        original(records, build_id, status)

    monkeypatch.setattr(BuildRecords, "set_status", record)

    def many_ticks(progress: Callable[[str, float], None], cancelled: Callable[[], bool]) -> None:
        for tick in itertools.count():
            progress("two", 1 - 1 / (1 + tick))
            let_pass(0.001)
            if len(written) >= 4:
                return

    waits: list[float] = []

    def select_and_note(*arguments: Any) -> Any:
        waits.append(arguments[-1])
        return select.select(*arguments)

    monkeypatch.setattr(build_reporter, "select", SimpleNamespace(select=select_and_note))
    assert place.run(TinyPipeline(many_ticks)) == 0
    assert set(waits) == {0.5}
    assert 4 < len(written) <= 2 + len(waits)  # at the start, one after each wait, the end
    assert [status["state"] for status in written] == ["running"] * (len(written) - 1) + ["succeeded"]
    fractions = [status["progress"] for status in written]
    assert fractions == sorted(fractions)
    assert {status["stage"] for status in written[1:-1]} <= {"two", "publish"}


@dataclass
class EarlyPipeline(TinyPipeline):
    """Hands out a provisional version first, then goes on as ``TinyPipeline``."""

    def __call__(self, job: BuildJob) -> BuildResult:
        job.progress("one", 1.0)
        if job.publish_provisional is not None:
            directory = job.work / "provisional"
            directory.mkdir(exist_ok=True)
            (directory / "index.bin").write_bytes(b"coarse")
            job.progress("provisional", 0.5)
            job.publish_provisional(
                BuildResult(directory, Manifest.for_directory(directory, provisional=True))
            )
        return super().__call__(job)


def test_a_provisional_version_serves_until_the_full_one_is_there(place: Place) -> None:
    seen: list[tuple[bool, str | None]] = []

    def look(progress: Callable[[str, float], None], cancelled: Callable[[], bool]) -> None:
        (info,) = place.catalog.versions("hall")
        wait_until(lambda: place.catalog.builds.status("b1")["provisional_version"] is not None)
        seen.append((info.provisional, place.catalog.builds.status("b1")["provisional_version"]))
        assert place.catalog.active_version("hall") == info.version == seen[0][1]

    assert place.run(EarlyPipeline(act=look)) == 0
    assert seen[0][0]
    status = place.catalog.builds.status("b1")
    assert status["provisional_version"] == seen[0][1]
    (info,) = place.catalog.versions("hall")
    assert (info.version, info.active, info.provisional) == (status["version"], True, False)
    place.request("b2")
    assert place.run(EarlyPipeline(), "b2") == 0
    assert place.catalog.builds.status("b2")["provisional_version"] is None, "the old full version is better"


@pytest.mark.parametrize("ends", ["failed", "cancelled"])
def test_a_build_that_ends_badly_leaves_nothing_but_its_record(place: Place, ends: str) -> None:
    def end(progress: Callable[[str, float], None], cancelled: Callable[[], bool]) -> None:
        raise BuildFailed("no floor") if ends == "failed" else BuildCancelled("enough")

    place.run(EarlyPipeline(act=end))
    status = place.catalog.builds.status("b1")
    assert status["state"] == ends
    assert status["version"] is None
    assert status["provisional_version"] is not None, "it says what it had published"
    assert place.catalog.active_version("hall") is None
    assert place.catalog.state("hall").published == ()
    assert place.catalog.store.list("maps/hall/sources") == []


def test_a_provisional_version_can_be_forbidden(place: Place) -> None:
    place.request("b2", config={"provisional": False})
    assert place.run(EarlyPipeline(), "b2") == 0
    assert place.run(EarlyPipeline(), provisional=False) == 0
    assert place.catalog.builds.status("b1")["provisional_version"] is None
    assert place.catalog.builds.status("b2")["provisional_version"] is None


def test_a_cancel_that_no_stage_looks_for_stops_the_publish(place: Place) -> None:
    def wait(progress: Callable[[str, float], None], cancelled: Callable[[], bool]) -> None:
        place.catalog.builds.request_cancel("b1")
        wait_until(cancelled)

    assert place.run(TinyPipeline(wait)) == 3
    assert place.catalog.log("hall") == []


def _fail(error: BaseException) -> TinyPipeline:
    def act(progress: Callable[[str, float], None], cancelled: Callable[[], bool]) -> None:
        progress("two", 0.1)
        raise error

    return TinyPipeline(act)


@pytest.mark.parametrize(
    ("error", "code", "detail"),
    [
        (BuildFailed("the cloud has no floor"), "build_failed", "the cloud has no floor"),
        (TooLarge("too many points"), "too_large", "too many points"),
        (MemoryError(), "build_failed", MEMORY_REACHED),
        (KeyError("/home/secret"), "internal", "KeyError: see the worker's log"),
    ],
)
def test_a_failure_is_recorded_with_its_code(error: Exception, code: str, detail: str, place: Place) -> None:
    assert place.run(_fail(error)) == 1
    status = place.catalog.builds.status("b1")
    assert (status["state"], status["stage"]) == ("failed", "two")
    assert status["error"]["code"] == code
    assert re.fullmatch(re.escape(detail) + "([0-9]+ bytes are left)?", status["error"]["detail"])
    assert place.catalog.log("hall") == []


def test_a_build_that_has_ended_is_left_alone(place: Place) -> None:
    assert place.run(TinyPipeline()) == 0
    before = place.catalog.store.list()
    pipeline = TinyPipeline()
    assert place.run(pipeline) == 0
    assert pipeline.calls == []
    assert place.catalog.store.list() == before
    for state, code in (("failed", 1), ("cancelled", 3)):
        place.catalog.builds.set_status("b1", new_status(state, map_id="hall"))
        assert place.run(pipeline) == code
    assert pipeline.calls == []


def test_a_status_under_way_does_not_cover_that_the_build_waits(place: Place, monkeypatch) -> None:
    """A slow store takes the reporter's status of a running build while the build fails."""
    put, under_way, queued = BuildRecords.set_status, threading.Event(), threading.Event()

    def set_status(self: BuildRecords, build_id: str, status: dict[str, Any]) -> None:
        if threading.current_thread().name == "build-reporter":
            under_way.set()
            queued.wait(1.0)  # where the writer below waits for this thread, it does not come
        put(self, build_id, status)
        if status["state"] == "queued":
            queued.set()

    def act(progress: Callable[[str, float], None], cancelled: Callable[[], bool]) -> None:
        progress("one", 0.5)
        assert under_way.wait(LIMIT_S)
        raise StoreUnavailable("gone")

    monkeypatch.setattr(BuildRecords, "set_status", set_status)
    with pytest.raises(StoreUnavailable):
        place.run(TinyPipeline(act))
    assert place.catalog.builds.status("b1")["state"] == "queued"


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (StoreUnavailable("gone"), "store_unavailable"),
        (ClusterUnavailable("gone"), "cluster_unavailable"),
        (OutOfSpace("the store is full"), "out_of_space"),
        (OSError(errno.ENOSPC, "No space left on device"), "out_of_space"),
    ],
)
def test_a_failure_of_store_cluster_or_disk_leaves_the_build_queued(
    error: Exception, code: str, place: Place
) -> None:
    with pytest.raises(OutOfSpace if code == "out_of_space" else type(error)):
        place.run(_fail(error))
    status = place.catalog.builds.status("b1")
    assert (status["state"], status["error"]["code"]) == ("queued", code)
    if isinstance(error, OSError):
        assert re.search("work disk is full: [0-9]+ bytes are left", status["error"]["detail"])
    assert place.run(TinyPipeline()) == 0
    assert place.catalog.builds.status("b1")["error"] is None


def test_builds_that_share_a_folder_run_one_after_the_other(place: Place) -> None:
    place.request("b2", config={"x": 2})
    running: list[str] = []

    def act(progress: Callable[[str, float], None], cancelled: Callable[[], bool]) -> None:
        running.append("in")
        let_pass(0.3)
        running.append("out")

    threads = [
        threading.Thread(target=place.run, args=(TinyPipeline(act), build_id)) for build_id in ("b1", "b2")
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert running == ["in", "out"] * 2
    assert len(place.catalog.versions("hall")) == 2


def test_an_unknown_build_is_not_found(place: Place) -> None:
    with pytest.raises(NotFound):
        place.run(TinyPipeline(), "b9")


def _refused(place: Place, options: dict[str, Any] | None = None, **changes: Any) -> dict[str, str]:
    place.request("bad", **changes)
    pipeline = TinyPipeline()
    assert place.run(pipeline, "bad", **options or {}) == 1
    assert pipeline.calls == []
    error: dict[str, str] = place.catalog.builds.status("bad")["error"]
    return error


@pytest.mark.parametrize(
    "changes",
    [
        {"source": {"key": "maps/office/sources/" + "0" * 64}},
        {"source": {"key": "maps/hall/log/000001.json"}},
        {"source": {"key": "../../etc/passwd"}},
        {"source": {"url": "file:///etc/passwd"}},
        {"source": {"url": "/etc/passwd"}},
        {"source": {"url": "memory://x/y"}},
        {"source": {"url": "s3://bucket/map.ply?endpoint=http://169.254.169.254&allow_http=true"}},
        {"source": {"url": "s3://bucket"}},
        {"source": {"url": "https://host/map.ply"}},
        {"source": {}},
    ],
)
def test_a_source_that_is_not_the_callers_is_refused(changes: dict[str, Any], place: Place) -> None:
    assert _refused(place, **changes)["code"] == "invalid_option"


@pytest.mark.parametrize("changes", [{"source": "text"}, {"config": [1]}, {"map_id": "../x"}])
def test_a_request_of_another_form_is_not_run(changes: dict[str, Any], place: Place) -> None:
    place.request("bad", **changes)
    pipeline = TinyPipeline()
    with pytest.raises(UnreadableRecord):
        place.run(pipeline, "bad")
    assert pipeline.calls == []


def test_a_source_that_is_gone_or_too_large_is_refused(place: Place) -> None:
    error = _refused(place, {"max_source_bytes": 3})
    assert error["code"] == "too_large"
    place.catalog.store.delete(place.catalog.builds.request("b1")["source"]["key"])
    place.request("b3")
    assert place.run(TinyPipeline(), "b3") == 1
    assert place.catalog.builds.status("b3")["error"]["code"] == "not_found"


def test_a_file_url_is_read_below_a_folder_that_was_allowed(place: Place, tmp_path: Path) -> None:
    maps = tmp_path / "maps"
    maps.mkdir()
    (maps / "yard.pcd").write_bytes(b"points")
    (maps / "link.pcd").symlink_to("/etc/passwd")
    place.request("b2", source={"url": f"file://{maps}/yard.pcd"}, file_name=None)
    pipeline = TinyPipeline()
    assert place.run(pipeline, "b2", source_roots=(maps,)) == 0
    assert pipeline.calls[0]["source"] == "yard.pcd"
    for i, name in enumerate(("../upload", "link.pcd", "none.pcd")):
        place.request(f"c{i}", source={"url": f"file://{maps}/{name}"})
        assert place.run(TinyPipeline(), f"c{i}", source_roots=(maps,)) == 1


def test_an_object_elsewhere_on_the_same_server_is_a_source(s3_url: str, tmp_path: Path) -> None:
    place = make_place(s3_url.replace("?", "/own?"), tmp_path)
    outside = Store.open(s3_url)
    outside.put("clouds/yard.las", b"points")
    bare = s3_url.split("?")[0]
    place.request("b2", source={"url": f"{bare}/clouds/yard.las"}, file_name="")
    pipeline = TinyPipeline()
    assert place.run(pipeline, "b2") == 0
    assert pipeline.calls[0]["source"] == "yard.las"
    key = place.catalog.builds.request("b1")["source"]["key"]
    for url, code in (
        (f"{bare}/own/{key}", "invalid_option"),  # another map's upload, by the back door
        (f"{bare}/clouds/none.las", "not_found"),
        (f"{bare}/clouds/yard.las?endpoint=http://127.0.0.1:9", "invalid_option"),
    ):
        build_id = f"c{abs(hash(url))}"
        place.request(build_id, source={"url": url})
        assert place.run(TinyPipeline(), build_id) == 1
        assert place.catalog.builds.status(build_id)["error"]["code"] == code


@pytest.mark.slow
def test_the_command_line_with_the_real_pipeline(place: Place) -> None:
    def run(*arguments: str) -> int:
        command = [sys.executable, "-m", "firstfix_builder.worker", "--store", place.url, *arguments]
        return subprocess.run(command, capture_output=True, timeout=LIMIT_S, check=False).returncode

    place.request("b2", config={"sensor": "no-such-lidar"})
    assert run("--work", str(place.work), "--build", "b2") == 1
    error = place.catalog.builds.status("b2")["error"]
    assert error["code"] == "invalid_option"
    assert "no-such-lidar" in error["detail"]
    assert run("--work", str(place.work), "--build", "b9") == 2
    assert run("--build", "b1") == 2
    assert run("--work", str(place.work), "--build", "b1", "--executor", "dask://nowhere") == 2
    assert place.catalog.builds.status("b1")["state"] == "queued"
