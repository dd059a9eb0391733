from __future__ import annotations

import asyncio
import threading
import time

import pytest

from firstfix.errors import DeadlineExceeded, Overloaded
from firstfix_service.pool import QueryPool


def test_work_is_done_and_its_error_passed_on():
    pool = QueryPool(1, 0)
    assert asyncio.run(pool.run(lambda: 42)) == 42
    with pytest.raises(ZeroDivisionError):
        asyncio.run(pool.run(lambda: 1 // 0))
    assert pool.admitted == 0
    pool.close()


def test_the_queue_is_bounded_and_empties():
    pool, gate = QueryPool(2, 3), threading.Event()
    futures = [pool.submit(gate.wait) for _ in range(5)]
    with pytest.raises(Overloaded):
        pool.submit(gate.wait)
    assert pool.admitted == 5
    gate.set()
    assert all(future.result(10) for future in futures)
    assert pool.submit(lambda: "free again").result(10) == "free again"
    pool.close()


def test_a_late_answer_is_given_up_at_the_deadline_but_keeps_its_place():
    pool, gate = QueryPool(1, 0), threading.Event()
    start = time.monotonic()

    async def ask() -> None:
        with pytest.raises(DeadlineExceeded):
            await pool.run(lambda: gate.wait(10), time.monotonic() + 0.1)
        with pytest.raises(Overloaded):  # its thread works on: more must not pile up behind it
            await pool.run(lambda: None)

    asyncio.run(ask())
    assert time.monotonic() - start < 5
    gate.set()
    pool.close()
    assert pool.admitted == 0


def test_work_whose_time_is_over_is_not_begun():
    pool, gate, ran = QueryPool(1, 1), threading.Event(), threading.Event()
    first = pool.submit(gate.wait)
    second = pool.submit(ran.set, time.monotonic() + 0.05)
    time.sleep(0.1)
    gate.set()
    with pytest.raises(DeadlineExceeded):
        second.result(10)
    assert first.result(10)
    assert not ran.is_set()
    pool.close()


def test_a_closed_pool_refuses():
    pool = QueryPool(1, 0)
    pool.close()
    with pytest.raises(Overloaded):
        pool.submit(lambda: None)
    assert pool.admitted == 0
