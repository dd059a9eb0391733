"""Turns by the workers' time, with a clock that the tests set: every order here is exact."""

from __future__ import annotations

import asyncio
import heapq
import math
from collections import Counter
from contextvars import copy_context
from typing import Any, cast

import pytest

from firstfix_service.limits import fair_queue
from firstfix_service.limits.asker import Asker
from firstfix_service.limits.fair_queue import FairQueue, Job, State
from firstfix_service.limits.limits import Limits

QUICK_S, HEAVY_S = 1 / 16, 2.0  # of binary fractions, whose sums are exact
USUAL_BYTES = 1000


class Simulated:
    """A fair queue and its workers, in a time of their own.

    Attributes:
        begun: names of the callers in the order of their turns.
        waited_s: of each query of a caller, in order.
    """

    def __init__(self, workers: int) -> None:
        self.now = 0.0
        self.queue = FairQueue(workers, lambda: self.now)
        self.begun: list[str] = []
        self.waited_s: dict[str, list[float]] = {}
        self.used_s: Counter[str] = Counter()
        self.cancelled: set[Job] = set()
        self._seconds: dict[Job, float] = {}
        self._running: list[tuple[float, int, Job]] = []

    def ask(self, caller: str, seconds: float, map_id: str = "hall", size_bytes: int = USUAL_BYTES) -> Job:
        result = cast("asyncio.Future[Any]", None)
        job = Job(Asker(caller, map_id), _not_asked, result, math.inf, size_bytes, copy_context())
        self._seconds[job] = seconds
        self.queue.add(job)
        self.queue.make_ready(job)
        return job

    def begin(self) -> None:
        while (job := self.queue.next()) is not None:
            caller = job.asker.caller
            self.begun.append(caller if job.asker.map_id == "hall" else f"{caller} {job.asker.map_id}")
            self.waited_s.setdefault(caller, []).append(self.now - job.ready_since)
            heapq.heappush(self._running, (self.now + self._seconds[job], len(self.begun), job))

    def pass_until(self, moment: float) -> None:
        """Lets the workers work until then."""
        self.begin()
        while self._running and self._running[0][0] <= moment:
            self.now, _, job = heapq.heappop(self._running)
            self.queue.ended(job, self._seconds[job], is_whole=job not in self.cancelled)
            self.used_s[job.asker.caller] += self._seconds[job]
            self.begin()
        self.now = moment

    def finish(self) -> None:
        self.pass_until(self.now + 1e6)


def _not_asked(prepared: Any, waited_s: float) -> Any:
    raise AssertionError("nobody is asked here")


def test_a_quick_caller_never_waits_for_more_than_the_query_that_runs():
    """One worker. The flood has sixty queries in the pool all the time, the robot asks ten times a second."""
    sim = Simulated(workers=1)
    for tenth in range(1000):
        while sim.queue.size < 60:
            sim.ask("flood", HEAVY_S)
        if tenth % 30 == 29:  # when one has ended, another one has begun
            sim.ask("robot", QUICK_S)
        sim.pass_until(tenth * 0.125)
    assert len(sim.waited_s["robot"]) >= 30
    assert max(sim.waited_s["robot"]) <= HEAVY_S
    assert sim.used_s["flood"] > 100, "who asks alone has the rest"


def test_a_slow_caller_leaves_one_worker_to_the_others():
    sim = Simulated(workers=2)
    sim.ask("robot", QUICK_S)
    sim.pass_until(1)
    sim.ask("flood", HEAVY_S)
    sim.pass_until(4)
    sim.begun.clear()
    sim.waited_s.clear()
    for tenth in range(400):
        while sim.queue.size < 30:
            sim.ask("flood", HEAVY_S)
        sim.ask("robot", QUICK_S)
        sim.pass_until(4 + (tenth + 1) * 0.125)
    assert max(sim.waited_s["robot"]) == 0.0
    assert sim.used_s["flood"] == pytest.approx(50, abs=3), "one worker, all the time"


def test_a_slow_caller_alone_has_every_worker():
    sim = Simulated(workers=3)
    for _ in range(9):
        sim.ask("flood", HEAVY_S)
    sim.finish()
    assert sim.waited_s["flood"] == [
        0,
        0,
        0,
        HEAVY_S,
        HEAVY_S,
        HEAVY_S,
        2 * HEAVY_S,
        2 * HEAVY_S,
        2 * HEAVY_S,
    ]


def test_a_slow_caller_has_every_worker_again_once_the_others_are_gone():
    sim = Simulated(workers=2)
    sim.ask("robot", QUICK_S)
    sim.ask("flood", HEAVY_S)
    sim.pass_until(3)
    sim.begun.clear()
    for _ in range(2):
        sim.ask("flood", HEAVY_S)
    sim.begin()
    assert sim.begun == ["flood"]
    sim.pass_until(4)
    sim.now = 1 + Limits.recent_s
    sim.begin()
    assert sim.begun == ["flood", "flood"]


def test_callers_share_the_time_and_not_the_turns():
    sim = Simulated(workers=1)
    for _ in range(200):
        sim.ask("long", 4 * QUICK_S)
        sim.ask("short", QUICK_S)
    sim.pass_until(20.0)
    assert sim.used_s["long"] == pytest.approx(10.0, abs=4 * QUICK_S)
    assert sim.used_s["short"] == pytest.approx(10.0, abs=4 * QUICK_S)


def test_a_caller_of_many_maps_has_one_share():
    sim = Simulated(workers=1)
    for _ in range(30):
        for map_id in ("a", "b", "c"):
            sim.ask("many", QUICK_S, map_id)
        sim.ask("one", QUICK_S)
    sim.pass_until(40 * QUICK_S)
    assert sim.used_s["one"] == pytest.approx(20 * QUICK_S, abs=QUICK_S)


def test_a_slow_map_of_a_caller_holds_up_that_caller_alone():
    """Its quick map has half of its time, and the other caller half of all."""
    sim = Simulated(workers=1)
    for _ in range(200):
        sim.ask("a", 8 * QUICK_S, "slow")
        sim.ask("a", QUICK_S, "quick")
        sim.ask("b", QUICK_S)
    sim.pass_until(400 * QUICK_S)
    turns = Counter(sim.begun)
    assert turns["b"] == pytest.approx(200, abs=16)
    assert turns["a quick"] == pytest.approx(100, abs=16)
    assert turns["a slow"] == pytest.approx(12, abs=2)


def test_a_new_caller_does_not_go_before_earlier_ones():
    """A newcomer begins at the present: time that it has not used is not saved up."""
    sim = Simulated(workers=1)
    for _ in range(80):
        sim.ask("old", QUICK_S)
    sim.pass_until(40 * QUICK_S)
    sim.begun.clear()
    for _ in range(10):
        sim.ask("new", QUICK_S)
    sim.pass_until(60 * QUICK_S)
    assert Counter(sim.begun)["old"] in (10, 11), "turn by turn"


def test_earlier_use_does_not_count_after_a_pause():
    sim = Simulated(workers=1)
    for _ in range(10):
        sim.ask("a", QUICK_S)
    sim.finish()
    for _ in range(10):
        sim.ask("b", QUICK_S)
    sim.finish()
    sim.begun.clear()
    for _ in range(4):
        sim.ask("b", QUICK_S)
        sim.ask("a", QUICK_S)
    sim.finish()
    assert Counter(sim.begun[:4]) == {"a": 2, "b": 2}


def test_unused_turns_are_not_saved_up():
    """The flood is held back for its slow queries. When they become quick, it has no credit."""
    sim = Simulated(workers=2)
    sim.ask("robot", QUICK_S)
    sim.ask("flood", 8.0)
    sim.pass_until(8)
    sim.ask("flood", 32.0, "slow")
    for _ in range(40):
        sim.ask("flood", 32.0)
    for _ in range(100):
        sim.ask("robot", 4 * QUICK_S)
    sim.pass_until(30)
    flood = sim.queue._callers["flood"]
    assert flood.used_s >= sim.queue._virtual_time_s


def test_the_first_heavy_queries_of_an_unknown_caller_count_as_heavy():
    """A query is expected to take longer than the usual one as many times as it is larger."""
    sim = Simulated(workers=2)
    for _ in range(20):
        sim.ask("robot", QUICK_S)
        sim.pass_until(sim.now + 0.125)
    sim.begun.clear()
    for _ in range(5):
        sim.ask("unknown", 5.0, size_bytes=80 * USUAL_BYTES)
    sim.begin()
    assert sim.begun == ["unknown"], "one worker is left"
    for _ in range(5):
        sim.ask("light", QUICK_S)
        sim.pass_until(sim.now + 0.125)
    assert sim.begun == ["unknown", *["light"] * 5]
    assert sim.queue._callers["unknown"].used_s - sim.queue._virtual_time_s >= 80 * QUICK_S - 1


def test_expected_time_is_corrected_by_the_time_taken():
    sim = Simulated(workers=1)
    sim.ask("robot", QUICK_S)
    sim.pass_until(1)
    sim.ask("large", QUICK_S, size_bytes=1000 * USUAL_BYTES)
    sim.begin()
    assert sim.queue._callers["large"].used_s >= 1000 * QUICK_S
    sim.finish()
    assert sim.queue._callers["large"].used_s == sim.queue._virtual_time_s + QUICK_S


def test_a_full_queue_drops_the_newest_of_the_caller_with_most():
    sim = Simulated(workers=1)
    jobs = [sim.ask("flood", HEAVY_S, map_id) for map_id in ("a", "b", "b", "b", "a")]
    sim.ask("robot", QUICK_S)
    sim.begin()
    assert sim.queue.crowding(Asker("robot", "hall")) is jobs[3], "of its map with most"
    assert sim.queue.crowding(Asker("stranger", "hall")) is jobs[3]
    assert sim.queue.crowding(Asker("flood", "b")) is None
    assert sim.queue.crowding(Asker("flood", "c")) is jobs[3], "for another map of its own"
    for job in (jobs[3], jobs[4], jobs[2]):
        sim.queue.remove(job)
        assert job.state is State.GONE
    assert sim.queue.crowding(Asker("robot", "hall")) is None, "it has as many as the robot would have"


def test_abandoned_work_counts_for_its_caller():
    """A caller cannot free its places by leaving: work that runs keeps its place until it ends."""
    sim = Simulated(workers=2)
    first = [sim.ask("flood", HEAVY_S) for _ in range(3)]
    sim.begin()
    assert [job.state for job in first] == [State.RUNNING, State.RUNNING, State.READY]
    assert sim.queue.crowding(Asker("robot", "hall")) is first[2], "three to none"


def test_a_cancelled_query_tells_only_that_a_usual_one_is_no_quicker():
    run = Simulated(1)

    def cancelled_after(seconds: float) -> float:
        run.cancelled.add(run.ask("robot", seconds))
        run.finish()
        usual = run.queue.usual
        return 0.0 if usual is None else usual.seconds

    assert cancelled_after(HEAVY_S) == 0.0, "no query has ended yet"
    run.ask("robot", 1.0)
    run.finish()
    assert cancelled_after(QUICK_S) == 1.0
    assert cancelled_after(HEAVY_S) == pytest.approx(1.1)


def test_who_lets_every_query_be_cancelled_is_charged_for_them_all_the_same():
    run = Simulated(1)
    run.ask("other", HEAVY_S)
    run.finish()
    run.begun.clear()
    run.cancelled.add(run.ask("quitter", 1.0))
    run.begin()
    for _ in range(2):
        run.ask("robot", QUICK_S)
    run.pass_until(run.now + 1.0)
    run.cancelled.add(run.ask("quitter", 1.0))
    run.finish()
    assert run.begun == ["quitter", "robot", "robot", "quitter"]


def test_invented_maps_and_idle_callers_are_forgotten(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(fair_queue, "MAX_IDLE", 40)
    sim = Simulated(workers=1)
    invented = sim.ask("a", QUICK_S, "invented")
    sim.queue.remove(invented)
    assert not sim.queue._callers
    for number in range(50):
        sim.ask(f"caller {number}", QUICK_S)
        sim.finish()
    assert len(sim.queue._callers) == 40 == len(sim.queue._idle)
    assert "caller 9" not in sim.queue._callers
    assert "caller 10" in sim.queue._callers
    assert sim.queue.size == 0
    assert not any(names.present for names in sim.queue._slow._names)


def test_a_quick_query_is_not_slow_for_its_maps_others():
    """The flood makes its own queries in the map slow, not the robot's."""
    sim = Simulated(workers=2)
    sim.ask("other", QUICK_S, "yard")
    sim.ask("robot", QUICK_S)
    sim.pass_until(1)
    sim.ask("flood", HEAVY_S)
    sim.pass_until(4)
    sim.begun.clear()
    for _ in range(3):
        sim.ask("flood", HEAVY_S)
    sim.ask("robot", QUICK_S)
    sim.begin()
    assert sim.begun == ["flood", "robot"] or sim.begun == ["robot", "flood"]
    assert HEAVY_S > Limits.slow_query_s > QUICK_S
