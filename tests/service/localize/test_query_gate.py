from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any

import pytest

from firstfix.errors import DeadlineExceeded, NotFound, Overloaded
from firstfix_service.localize.asker import Asker
from firstfix_service.localize.query_gate import MAX_RETRY_AFTER_S, QueryPool
from firstfix_service.localize.slow_share import SLOW_S
from waiting import let_pass, wait_until_async


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


def with_pool(
    test: Callable[[QueryPool], Coroutine[Any, Any, None]], workers: int = 1, queue_size: int = 0
) -> None:
    async def run() -> None:
        pool = QueryPool(workers, queue_size)
        try:
            await test(pool)
        finally:
            await pool.close()
        assert pool.admitted == 0

    asyncio.run(run())


class Tasks:
    """Queries that record their start and wait for a gate."""

    def __init__(self, pool: QueryPool) -> None:
        self.pool = pool
        self.gate = threading.Event()
        self.begun: list[str] = []

    def ask(
        self,
        map_id: str,
        name: str = "",
        *,
        caller: str = "robot",
        prepare: Callable[[], Future[Held]] | None = None,
        deadline: float | None = None,
        seconds: float = 0.0,
    ) -> asyncio.Task[str]:
        async def work(held: Held, waited_s: float) -> str:
            self.begun.append(name or map_id)
            await asyncio.to_thread(let_pass, seconds)
            await wait_until_async(self.gate.is_set)
            return name or map_id

        return asyncio.ensure_future(
            self.pool.run(Asker(caller, map_id), prepare or ready(), work, deadline=deadline)
        )


def test_work_is_done_and_its_error_passed_on():
    async def test(pool: QueryPool) -> None:
        held = Held()

        async def is_held(got: Held, waited_s: float) -> bool:
            return got is held

        async def fail(got: Held, waited_s: float) -> None:
            raise ZeroDivisionError

        assert await pool.run(Asker("robot", "a"), ready(held), is_held)
        assert held.closed == 1
        with pytest.raises(ZeroDivisionError):
            await pool.run(Asker("robot", "a"), ready(held), fail)
        assert held.closed == 2

    with_pool(test)


def test_the_queue_is_bounded_and_empties():
    async def test(pool: QueryPool) -> None:
        tasks = Tasks(pool)
        asked = [tasks.ask("a") for _ in range(5)]
        await wait_until_async(lambda: pool.admitted == 5)
        with pytest.raises(Overloaded):
            pool.check_room(Asker("robot", "a"))
        with pytest.raises(Overloaded):
            await tasks.ask("a")
        tasks.gate.set()
        assert await asyncio.gather(*asked) == ["a"] * 5
        assert await tasks.ask("a", "free again") == "free again"

    with_pool(test, workers=2, queue_size=3)


def test_the_wait_that_a_refusal_names_grows_with_the_queue():
    async def test(pool: QueryPool) -> None:
        for _ in range(60):
            await pool.run(Asker("robot", "a"), ready(), lambda *_: asyncio.to_thread(let_pass, 0.02))
        tasks = Tasks(pool)
        asked = [tasks.ask("a") for _ in range(201)]
        await wait_until_async(lambda: pool.admitted == 201)
        with pytest.raises(Overloaded) as refused:
            pool.check_room(Asker("robot", "a"))
        assert 201 * 0.02 < refused.value.retry_after_s <= MAX_RETRY_AFTER_S, "what each has taken, for all"
        tasks.gate.set()
        await asyncio.gather(*asked)

    with_pool(test, queue_size=200)


@pytest.mark.parametrize("who", [("robot", "robot"), ("flood", "robot")], ids=["maps", "callers"])
def test_a_full_queue_takes_in_who_has_few_for_who_has_most(who: tuple[str, str]):
    async def test(pool: QueryPool) -> None:
        tasks, (many, few) = Tasks(pool), who
        busy = [tasks.ask("busy", f"busy {k}", caller=many) for k in range(6)]
        await wait_until_async(lambda: pool.admitted == 6)
        pool.check_room(Asker(few, "quiet"))
        quiet = [tasks.ask("quiet", f"quiet {k}", caller=few) for k in range(4)]
        with pytest.raises(Overloaded) as refused:
            await busy[-1]
        assert refused.value.retry_after_s
        await wait_until_async(lambda: quiet[-1].done())
        assert isinstance(quiet[-1].exception(), Overloaded), "with a fair share there is no more"
        tasks.gate.set()
        assert await asyncio.gather(*busy[:3], *quiet[:3])
        assert [task.done() and task.exception() is not None for task in busy] == [False] * 3 + [True] * 3

    with_pool(test, queue_size=5)


def test_what_is_still_prepared_holds_no_worker():
    async def test(pool: QueryPool) -> None:
        tasks = Tasks(pool)
        tasks.gate.set()
        slow: Future[Held] = Future()
        waiting = [tasks.ask("loading", prepare=lambda: slow) for _ in range(3)]
        await wait_until_async(lambda: pool.admitted == 3)
        assert await tasks.ask("loaded") == "loaded"
        slow.set_result(Held())
        assert await asyncio.gather(*waiting) == ["loading"] * 3

    with_pool(test, queue_size=10)


def test_what_cannot_be_prepared_is_the_querys_error():
    async def test(pool: QueryPool) -> None:
        failed: Future[Held] = Future()
        failed.set_exception(NotFound("no map"))
        with pytest.raises(NotFound):
            await pool.run(Asker("robot", "made-up"), lambda: failed, lambda *_: asyncio.sleep(0))

        def refuses() -> Future[Held]:
            raise NotFound("no such id")

        with pytest.raises(NotFound):
            await pool.run(Asker("robot", "made-up"), refuses, lambda *_: asyncio.sleep(0))
        assert not pool._queue._callers, "a map that was made up leaves no trace"

    with_pool(test)


def test_a_slow_map_leaves_a_worker_to_the_others():
    async def test(pool: QueryPool) -> None:
        tasks = Tasks(pool)
        tasks.gate.set()
        await tasks.ask("slow", seconds=SLOW_S * 1.2)
        await tasks.ask("quick")
        tasks.gate.clear()
        slow = [tasks.ask("slow") for _ in range(3)]
        await wait_until_async(lambda: tasks.begun.count("slow") == 2)
        quick = tasks.ask("quick", "in between")
        await wait_until_async(lambda: "in between" in tasks.begun)
        assert tasks.begun.count("slow") == 2
        tasks.gate.set()
        await asyncio.gather(*slow, quick)

    with_pool(test, workers=2, queue_size=10)


def test_a_slow_map_alone_has_every_worker():
    async def test(pool: QueryPool) -> None:
        tasks = Tasks(pool)
        tasks.gate.set()
        await tasks.ask("slow", seconds=SLOW_S * 1.2)
        tasks.gate.clear()
        slow = [tasks.ask("slow") for _ in range(3)]
        await wait_until_async(lambda: len(tasks.begun) == 3)
        tasks.gate.set()
        await asyncio.gather(*slow)

    with_pool(test, workers=2, queue_size=10)


def test_who_leaves_the_queue_makes_room_and_is_not_begun():
    async def test(pool: QueryPool) -> None:
        tasks, held = Tasks(pool), Held()
        running = tasks.ask("a", "running")
        await wait_until_async(lambda: tasks.begun)
        waiting = tasks.ask("a", "waiting", prepare=ready(held))
        await wait_until_async(lambda: pool.admitted == 2)
        waiting.cancel()
        await wait_until_async(lambda: pool.admitted == 1)
        assert held.closed == 1
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        assert pool.admitted == 1, "what runs keeps its place"
        tasks.gate.set()
        await wait_until_async(lambda: pool.admitted == 0)
        assert tasks.begun == ["running"]

    with_pool(test, queue_size=1)


def test_what_was_prepared_for_somebody_who_left_is_given_back():
    async def test(pool: QueryPool) -> None:
        slow: Future[Held] = Future()
        asked = asyncio.ensure_future(
            pool.run(Asker("robot", "a"), lambda: slow, lambda *_: asyncio.sleep(0))
        )
        await wait_until_async(lambda: pool.admitted == 1)
        asked.cancel()
        await wait_until_async(lambda: pool.admitted == 0)
        held = Held()
        slow.set_result(held)
        await wait_until_async(lambda: held.closed == 1)

    with_pool(test)


def test_a_late_answer_is_given_up_at_the_deadline_but_keeps_its_place():
    async def test(pool: QueryPool) -> None:
        tasks = Tasks(pool)
        with pytest.raises(DeadlineExceeded):
            await tasks.ask("a", deadline=time.monotonic() + 0.1)
        with pytest.raises(Overloaded):  # its worker works on: more must not pile up behind it
            await tasks.ask("a")
        tasks.gate.set()
        await wait_until_async(lambda: pool.admitted == 0)

    with_pool(test)


def test_work_whose_time_is_over_leaves_the_queue():
    async def test(pool: QueryPool) -> None:
        tasks = Tasks(pool)
        first = tasks.ask("a", "first")
        await wait_until_async(lambda: tasks.begun)
        with pytest.raises(DeadlineExceeded):
            await tasks.ask("a", "second", deadline=time.monotonic() + 0.05)
        assert pool.admitted == 1
        tasks.gate.set()
        await first
        assert tasks.begun == ["first"]

    with_pool(test, queue_size=1)


def test_a_closed_pool_refuses_what_waits_and_what_comes():
    async def test(pool: QueryPool) -> None:
        tasks = Tasks(pool)
        running, waiting = tasks.ask("a"), tasks.ask("a")
        await wait_until_async(lambda: pool.admitted == 2)
        closing = asyncio.ensure_future(pool.close())
        with pytest.raises(Overloaded, match="stopping"):
            await waiting
        tasks.gate.set()
        await closing
        assert await running == "a"
        with pytest.raises(Overloaded, match="stopping"):
            pool.check_room(Asker("robot", "a"))

    with_pool(test, queue_size=1)
