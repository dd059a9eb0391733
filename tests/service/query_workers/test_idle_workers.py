from __future__ import annotations

import asyncio
import threading

import pytest

from firstfix_service.query_workers.idle_workers import IdleWorkers


def test_the_one_that_worked_last_comes_first():
    async def test() -> None:
        idle: IdleWorkers[str] = IdleWorkers()
        for name in ("a", "b"):
            idle.put(name)
        assert [await idle.take(), await idle.take()] == ["b", "a"]

    asyncio.run(test())


def test_who_waits_gets_what_another_thread_puts():
    async def test() -> None:
        idle: IdleWorkers[int] = IdleWorkers()
        taking = [asyncio.ensure_future(idle.take()) for _ in range(3)]
        await asyncio.sleep(0)
        for number in range(3):
            threading.Thread(target=idle.put, args=(number,)).start()
        assert sorted(await asyncio.gather(*taking)) == [0, 1, 2]

    asyncio.run(test())


def test_one_who_gives_up_takes_nothing_from_the_next():
    async def test() -> None:
        idle: IdleWorkers[str] = IdleWorkers()
        gone, waits = asyncio.ensure_future(idle.take()), asyncio.ensure_future(idle.take())
        await asyncio.sleep(0)
        gone.cancel()
        with pytest.raises(asyncio.CancelledError):
            await gone
        idle.put("a")
        assert await waits == "a"

    asyncio.run(test())


def test_loops_that_have_ended_are_no_hindrance():
    idle: IdleWorkers[str] = IdleWorkers()

    async def give_up() -> None:
        taking = asyncio.ensure_future(idle.take())
        await asyncio.sleep(0)
        assert not taking.done()

    asyncio.run(give_up())
    idle.put("a")
    assert asyncio.run(idle.take()) == "a"
