from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any

import pytest

from firstfix.answer.localization import Verdict
from firstfix.errors import DeadlineExceeded, NotFound, Overloaded, QueryCancelled, WorkerLost
from firstfix_service.limits.asker import Asker
from firstfix_service.limits.limits import Limits
from firstfix_service.localize import query_gate
from firstfix_service.localize.query_gate import MAX_RETRY_AFTER_S, QueryGate
from firstfix_service.query_workers.base import QueryWorkerDied
from firstfix_service.query_workers.query import EncodedAnswer, Query
from tests.waiting import let_pass, wait_until_async


class Held:
    """Resources of a query; counts how often they were given back."""

    def __init__(self) -> None:
        self.closed = 0

    def close(self) -> None:
        self.closed += 1


def ready(held: Held | None = None) -> Callable[[], Future[Held]]:
    def prepare() -> Future[Held]:
        future: Future[Held] = Future()
        future.set_result(held or Held())
        return future

    return prepare


class Worker:
    """A worker that dies over so many queries. It does what it is asked, if that can be called."""

    def __init__(self, deaths: int = 0) -> None:
        self.is_alive = True
        self.asked: list[Query] = []
        self.cancelled: list[asyncio.Future[Any]] = []
        self._deaths = deaths

    def answer(self, query: Any) -> asyncio.Future[Any]:
        return asyncio.ensure_future(self._answer(query))

    def cancel(self, answer: asyncio.Future[Any]) -> None:
        self.cancelled.append(answer)

    async def _answer(self, query: Any) -> Any:
        self.asked.append(query)
        if callable(query):
            return await query()
        if self._deaths:
            self._deaths -= 1
            self.is_alive = False
            raise QueryWorkerDied
        return ANSWER


ANSWER = EncodedAnswer(Verdict.REJECTED, (), 0.0, "", "")
QUERY: Any = object()


def with_gate(
    test: Callable[[QueryGate], Coroutine[Any, Any, None]],
    workers: int = 1,
    queue_size: int = 0,
    up: int | None = None,
) -> None:
    async def run() -> None:
        gate = QueryGate(Limits(workers=workers, queue_size=queue_size))
        for _ in range(workers if up is None else up):
            gate.add_worker(Worker())
        try:
            await test(gate)
        finally:
            await gate.close()
        assert gate.admitted == 0

    asyncio.run(run())


def asking(what: Any) -> Any:
    """Asks a worker this, whatever was prepared."""
    return lambda held, waited_s: what


class Tasks:
    """Queries that record their start and wait for a signal."""

    def __init__(self, gate: QueryGate) -> None:
        self.gate = gate
        self.may_end = threading.Event()
        self.begun: list[str] = []

    def ask(
        self,
        map_id: str,
        name: str = "",
        *,
        caller: str = "robot",
        prepare: Callable[[], Future[Held]] | None = None,
        deadline: float = math.inf,
        seconds: float = 0.0,
    ) -> asyncio.Task[str]:
        async def work() -> str:
            self.begun.append(name or map_id)
            await asyncio.to_thread(let_pass, seconds)
            await wait_until_async(self.may_end.is_set)
            return name or map_id

        return asyncio.ensure_future(
            self.gate.run(Asker(caller, map_id), prepare or ready(), asking(work), deadline=deadline)
        )


def test_work_is_done_and_its_error_passed_on():
    async def test(gate: QueryGate) -> None:
        held, seen = Held(), []

        async def work() -> str:
            return "done"

        async def fail() -> None:
            raise ZeroDivisionError

        async def look(got: Held, error: Exception) -> None:
            seen.append((got, type(error), got.closed))

        def ask_for(got: Held, waited_s: float) -> Any:
            assert got is held
            assert waited_s >= 0.0
            return work

        assert await gate.run(Asker("robot", "a"), ready(held), ask_for, failed=look) == "done"
        assert (held.closed, seen) == (1, [])
        with pytest.raises(ZeroDivisionError):
            await gate.run(Asker("robot", "a"), ready(held), asking(fail), failed=look)
        assert (held.closed, seen) == (2, [(held, ZeroDivisionError, 1)]), "looked at before it is closed"

    with_gate(test)


def test_the_queue_is_bounded_and_empties():
    async def test(gate: QueryGate) -> None:
        tasks = Tasks(gate)
        asked = [tasks.ask("a") for _ in range(5)]
        await wait_until_async(lambda: gate.admitted == 5)
        with pytest.raises(Overloaded):
            gate.check_room(Asker("robot", "a"))
        with pytest.raises(Overloaded):
            await tasks.ask("a")
        tasks.may_end.set()
        assert await asyncio.gather(*asked) == ["a"] * 5
        assert await tasks.ask("a", "free again") == "free again"

    with_gate(test, workers=2, queue_size=3)


def test_the_wait_that_a_refusal_names_grows_with_the_queue():
    async def test(gate: QueryGate) -> None:
        for _ in range(60):
            await gate.run(Asker("robot", "a"), ready(), asking(lambda: asyncio.to_thread(let_pass, 0.02)))
        tasks = Tasks(gate)
        asked = [tasks.ask("a") for _ in range(201)]
        await wait_until_async(lambda: gate.admitted == 201)
        with pytest.raises(Overloaded) as refused:
            gate.check_room(Asker("robot", "a"))
        assert 201 * 0.02 < refused.value.retry_after_s <= MAX_RETRY_AFTER_S, "what each has taken, for all"
        tasks.may_end.set()
        await asyncio.gather(*asked)

    with_gate(test, queue_size=200)


@pytest.mark.parametrize("who", [("robot", "robot"), ("flood", "robot")], ids=["maps", "callers"])
def test_a_full_queue_drops_queries_of_the_caller_with_most(who: tuple[str, str]):
    async def test(gate: QueryGate) -> None:
        tasks, (many, few) = Tasks(gate), who
        busy = [tasks.ask("busy", f"busy {k}", caller=many) for k in range(6)]
        await wait_until_async(lambda: gate.admitted == 6)
        gate.check_room(Asker(few, "quiet"))
        quiet = [tasks.ask("quiet", f"quiet {k}", caller=few) for k in range(4)]
        with pytest.raises(Overloaded) as refused:
            await busy[-1]
        assert refused.value.retry_after_s
        await wait_until_async(lambda: quiet[-1].done())
        assert isinstance(quiet[-1].exception(), Overloaded), "with a fair share there is no more"
        tasks.may_end.set()
        assert await asyncio.gather(*busy[:3], *quiet[:3])
        assert [task.done() and task.exception() is not None for task in busy] == [False] * 3 + [True] * 3

    with_gate(test, queue_size=5)


def test_a_query_in_preparation_holds_no_worker():
    async def test(gate: QueryGate) -> None:
        tasks = Tasks(gate)
        tasks.may_end.set()
        slow: Future[Held] = Future()
        waiting = [tasks.ask("loading", prepare=lambda: slow) for _ in range(3)]
        await wait_until_async(lambda: gate.admitted == 3)
        assert await tasks.ask("loaded") == "loaded"
        slow.set_result(Held())
        assert await asyncio.gather(*waiting) == ["loading"] * 3

    with_gate(test, queue_size=10)


def test_an_error_in_preparation_is_the_querys_error():
    async def test(gate: QueryGate) -> None:
        failed: Future[Held] = Future()
        failed.set_exception(NotFound("no map"))
        with pytest.raises(NotFound):
            await gate.run(Asker("robot", "made-up"), lambda: failed, asks)

        def refuses() -> Future[Held]:
            raise NotFound("no such id")

        with pytest.raises(NotFound):
            await gate.run(Asker("robot", "made-up"), refuses, asks)
        assert not gate._queue._callers, "a map that was made up leaves no trace"

    with_gate(test)


def test_a_slow_map_leaves_a_worker_to_the_others():
    async def test(gate: QueryGate) -> None:
        tasks = Tasks(gate)
        tasks.may_end.set()
        await tasks.ask("slow", seconds=Limits.slow_query_s * 1.2)
        await tasks.ask("quick")
        tasks.may_end.clear()
        slow = [tasks.ask("slow") for _ in range(3)]
        await wait_until_async(lambda: tasks.begun.count("slow") == 2)
        quick = tasks.ask("quick", "in between")
        await wait_until_async(lambda: "in between" in tasks.begun)
        assert tasks.begun.count("slow") == 2
        tasks.may_end.set()
        await asyncio.gather(*slow, quick)

    with_gate(test, workers=2, queue_size=10)


def test_a_slow_map_alone_has_every_worker():
    async def test(gate: QueryGate) -> None:
        tasks = Tasks(gate)
        tasks.may_end.set()
        await tasks.ask("slow", seconds=Limits.slow_query_s * 1.2)
        tasks.may_end.clear()
        slow = [tasks.ask("slow") for _ in range(3)]
        await wait_until_async(lambda: len(tasks.begun) == 3)
        tasks.may_end.set()
        await asyncio.gather(*slow)

    with_gate(test, workers=2, queue_size=10)


def test_a_cancelled_query_frees_its_place_and_is_not_begun():
    async def test(gate: QueryGate) -> None:
        tasks, held = Tasks(gate), Held()
        running = tasks.ask("a", "running")
        await wait_until_async(lambda: tasks.begun)
        waiting = tasks.ask("a", "waiting", prepare=ready(held))
        await wait_until_async(lambda: gate.admitted == 2)
        waiting.cancel()
        await wait_until_async(lambda: gate.admitted == 1)
        assert held.closed == 1
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        assert gate.admitted == 1, "what runs keeps its place"
        tasks.may_end.set()
        await wait_until_async(lambda: gate.admitted == 0)
        assert tasks.begun == ["running"]

    with_gate(test, queue_size=1)


def test_resources_prepared_for_a_cancelled_query_are_closed():
    async def test(gate: QueryGate) -> None:
        slow: Future[Held] = Future()
        asked = asyncio.ensure_future(gate.run(Asker("robot", "a"), lambda: slow, asks))
        await wait_until_async(lambda: gate.admitted == 1)
        asked.cancel()
        await wait_until_async(lambda: gate.admitted == 0)
        held = Held()
        slow.set_result(held)
        await wait_until_async(lambda: held.closed == 1)

    with_gate(test)


def test_a_late_answer_is_given_up_at_the_deadline_but_keeps_its_place():
    async def test(gate: QueryGate) -> None:
        tasks = Tasks(gate)
        with pytest.raises(DeadlineExceeded):
            await tasks.ask("a", deadline=time.monotonic() + 0.1)
        with pytest.raises(Overloaded):  # its worker works on: more must not pile up behind it
            await tasks.ask("a")
        tasks.may_end.set()
        await wait_until_async(lambda: gate.admitted == 0)

    with_gate(test)


class Endless(Worker):
    """A worker whose queries end when they are cancelled."""

    async def _answer(self, query: Any) -> Any:
        self.asked.append(query)
        await wait_until_async(lambda: len(self.cancelled) == len(self.asked))
        raise QueryCancelled


@pytest.mark.parametrize("end", ["goes", "deadline"])
def test_a_running_query_for_which_nobody_waits_is_cancelled_at_its_worker(end: str):
    async def test(gate: QueryGate) -> None:
        worker, seen, held = Endless(), [], Held()
        gate.add_worker(worker)

        async def look(got: Held, error: Exception) -> None:
            seen.append(error)

        deadline = math.inf if end == "goes" else time.monotonic() + 0.1
        asked = asyncio.ensure_future(
            gate.run(Asker("robot", "a"), ready(held), asks, deadline=deadline, failed=look)
        )
        await wait_until_async(lambda: worker.asked)
        if end == "goes":
            asked.cancel()
        with pytest.raises(asyncio.CancelledError if end == "goes" else DeadlineExceeded):
            await asked
        await wait_until_async(lambda: gate.admitted == 0)
        assert (len(worker.cancelled), held.closed, seen) == (1, 1, []), "nothing is wrong with the files"
        assert gate._queue.usual is None, "it tells nothing of a usual query"
        after = asyncio.ensure_future(gate.run(Asker("robot", "a"), ready(), asks))
        await wait_until_async(lambda: len(worker.asked) == 2)  # it was free again
        after.cancel()
        await wait_until_async(lambda: gate.admitted == 0)

    with_gate(test, up=0)


def test_a_query_that_is_answered_is_not_cancelled():
    async def test(gate: QueryGate) -> None:
        worker = Worker()
        gate.add_worker(worker)
        assert await gate.run(Asker("robot", "a"), ready(), asks) is ANSWER
        assert worker.cancelled == []

    with_gate(test, up=0)


def test_a_query_whose_caller_goes_while_it_waits_for_another_worker_is_not_asked_again():
    async def test(gate: QueryGate) -> None:
        first, second = Worker(deaths=1), Worker()
        gate.add_worker(first)
        asked = asyncio.ensure_future(gate.run(Asker("robot", "a"), ready(), asks))
        await wait_until_async(lambda: gate._waiting_for_new_worker)
        asked.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asked
        gate.add_worker(second)
        await wait_until_async(lambda: gate.admitted == 0)
        assert (second.asked, gate._free) == ([], [second])

    with_gate(test, up=0)


def test_a_query_past_its_deadline_leaves_the_queue():
    async def test(gate: QueryGate) -> None:
        tasks = Tasks(gate)
        first = tasks.ask("a", "first")
        await wait_until_async(lambda: tasks.begun)
        with pytest.raises(DeadlineExceeded):
            await tasks.ask("a", "second", deadline=time.monotonic() + 0.05)
        assert gate.admitted == 1
        tasks.may_end.set()
        await first
        assert tasks.begun == ["first"]

    with_gate(test, queue_size=1)


def test_a_closed_gate_refuses_waiting_and_new_queries():
    async def test(gate: QueryGate) -> None:
        tasks = Tasks(gate)
        running, waiting = tasks.ask("a"), tasks.ask("a")
        await wait_until_async(lambda: gate.admitted == 2)
        closing = asyncio.ensure_future(gate.close())
        with pytest.raises(Overloaded, match="stopping"):
            await waiting
        tasks.may_end.set()
        await closing
        assert await running == "a"
        with pytest.raises(Overloaded, match="stopping"):
            gate.check_room(Asker("robot", "a"))

    with_gate(test, queue_size=1)


asks = asking(QUERY)


def test_a_query_waits_for_a_worker_under_its_own_deadline():
    async def test(gate: QueryGate) -> None:
        with pytest.raises(DeadlineExceeded):
            await gate.run(Asker("robot", "a"), ready(), asks, deadline=time.monotonic() + 0.1)
        assert gate.admitted == 0, "it has left the queue"
        asked = asyncio.ensure_future(gate.run(Asker("robot", "a"), ready(), asks))
        await wait_until_async(lambda: gate.admitted == 1)
        worker = Worker()
        gate.add_worker(worker)
        assert await asked is ANSWER
        assert worker.asked == [QUERY]

    with_gate(test, up=0)


def test_a_query_whose_worker_dies_is_asked_again_once():
    async def test(gate: QueryGate) -> None:
        first, second = Worker(deaths=1), Worker()
        gate.add_worker(first)
        asked = asyncio.ensure_future(gate.run(Asker("robot", "a"), ready(), asks))
        await wait_until_async(lambda: first.asked)
        gate.add_worker(second)
        assert await asked is ANSWER
        assert second.asked == [QUERY]
        second.is_alive = False
        gate.add_worker(Worker(deaths=1))
        lost = asyncio.ensure_future(gate.run(Asker("robot", "a"), ready(), asks))
        await wait_until_async(lambda: gate.admitted == 1)
        gate.add_worker(Worker(deaths=1))
        with pytest.raises(WorkerLost, match="two worker processes died"):
            await lost

    with_gate(test, up=0)


def test_a_query_that_lost_its_worker_goes_first():
    async def test(gate: QueryGate) -> None:
        first = Worker(deaths=1)
        gate.add_worker(first)
        waits = asyncio.ensure_future(gate.run(Asker("robot", "a"), ready(), asks))
        await wait_until_async(lambda: first.asked)
        tasks = Tasks(gate)
        other = tasks.ask("a", caller="other")
        await wait_until_async(lambda: gate.admitted == 2)
        gate.add_worker(Worker())
        assert await waits is ANSWER
        tasks.may_end.set()
        await other

    with_gate(test, up=0, queue_size=2)


def test_without_any_worker_waiting_queries_get_worker_lost(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(query_gate, "UP_WITHIN_S", 0.1)

    async def test(gate: QueryGate) -> None:
        with pytest.raises(WorkerLost, match="no worker process is up"):
            await gate.run(Asker("robot", "a"), ready(), asks)
        dies = Worker(deaths=1)
        gate.add_worker(dies)
        with pytest.raises(WorkerLost, match="no worker process is up"):
            await gate.run(Asker("robot", "a"), ready(), asks)
        assert dies.asked

    with_gate(test, up=0, queue_size=1)


def test_a_check_is_made_when_the_query_has_its_place_and_before_it_is_prepared():
    async def test(gate: QueryGate) -> None:
        async def refuse() -> None:
            assert gate.admitted == 1
            raise NotFound("not the body that was signed")

        def prepare() -> Future[Held]:
            raise AssertionError

        with pytest.raises(NotFound):
            await gate.run(Asker("robot", "a"), prepare, asks, check=refuse)

    with_gate(test)
