"""Builds that hang: they are killed, reported, and the next build runs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import pytest

from firstfix.errors import BuildError, BuildStalled, BuildTimedOut
from firstfix_service.builds import runner
from firstfix_service.builds.build_watch import BuildLimits, BuildWatch
from tests.nats_server import NEEDS_NATS, nats_server_program
from tests.service.builds_world import building_service, upload, wait_until_ended
from tests.service.nats_world import nats_world
from tests.service.service_world import FAKE_WORKER
from tests.waiting import wait_until

LIMITS = BuildLimits(timeout_s=1000.0, stall_s=100.0)


class Clock:
    now = 0.0

    def advance(self, seconds: float) -> None:
        self.now += seconds

    def __call__(self) -> float:
        return self.now


def status(progress: float, stage: str = "cluster") -> dict[str, Any]:
    return {"state": "running", "stage": stage, "progress": progress}


def kind(error: BuildError | None) -> type | None:
    return None if error is None else type(error)


def test_what_makes_progress_goes_on_until_its_time_is_over():
    clock = Clock()
    watch = BuildWatch(LIMITS, 300.0, clock)
    for step in range(14):
        clock.now = step * 50.0
        watch.see(status(step / 20))
        assert watch.overdue() is None
    clock.now = 701.0
    watch.see(status(0.9))
    assert kind(watch.overdue()) is BuildTimedOut, "with what earlier attempts ran"
    assert watch.ran_s == 701.0
    watch.stop()
    clock.now = 999.0
    assert watch.ran_s == 701.0


@pytest.mark.parametrize("moved", [status(0.2), status(0.1, "self_test")])
def test_what_makes_none_is_ended_and_a_new_stage_is_progress(moved: dict[str, Any]):
    clock = Clock()
    watch = BuildWatch(LIMITS, 0.0, clock)
    for now, seen, expected in (
        (0.0, status(0.1), None),
        (99.0, status(0.1), None),
        (100.0, moved, None),
        (199.0, moved, None),
        (201.0, moved, BuildStalled),
    ):
        clock.now = now
        watch.see(seen)
        assert kind(watch.overdue()) is expected, now


def test_a_store_that_is_away_says_nothing_of_the_build():
    clock = Clock()
    watch = BuildWatch(LIMITS, 0.0, clock)
    for now in range(0, 900, 90):
        clock.now = now
        watch.see(status(0.1) if now == 0 else None)
        assert watch.overdue() is None
    clock.now = 1001.0
    watch.see(None)
    assert kind(watch.overdue()) is BuildTimedOut, "that much is known without it"


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock by which running builds are watched; it moves only when the test says so."""
    clock = Clock()
    monkeypatch.setattr(runner, "BuildWatch", partial(BuildWatch, clock=clock))
    return clock


def test_a_build_that_hangs_is_ended_with_all_it_started_and_the_next_one_runs(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(runner, "build_limits", lambda settings: BuildLimits(1e6, stall_s=100.0))
    with building_service(tmp_path, build_lease_s=2, build_niceness=0) as service:
        hangs, after = upload(service, do="hang_with_a_child"), upload(service, "after")
        child = tmp_path / "work" / "child.txt"
        wait_until(lambda: child.exists() and child.read_text())
        wait_until(lambda: not is_alive(int(child.read_text())) or clock.advance(101.0))
        ended = wait_until_ended(service, hangs)
        assert (ended["state"], ended["stage"]) == ("failed", "describe")
        assert ended["error"] == {"code": "build_stalled", "detail": "the build made no progress for 100 s"}
        assert wait_until_ended(service, after)["state"] == "succeeded"


@pytest.mark.skipif(nats_server_program() is None, reason=NEEDS_NATS)
def test_a_worker_ends_a_build_that_never_does_and_takes_the_next(tmp_path: Path, clock: Clock):
    with nats_world(tmp_path) as world:
        world.start_worker_thread(build_command=FAKE_WORKER, build_timeout_s=100, build_niceness=0)
        endless, after = (
            world.record(config={"sensor": {"preset": "vlp-16", "name": do}})
            for do in ("work_for_ever", "succeed")
        )
        wait_until(lambda: world.state(endless) == "running")
        clock.advance(101.0)
        ended = world.wait_until_ended(endless)
        assert (ended["state"], ended["error"]["code"]) == ("failed", "build_timed_out")
        assert world.wait_until_ended(after)["state"] == "succeeded"
        wait_until(lambda: world.in_stream() == [])
