"""Background tasks: periodic runs, failures, and their end."""

from __future__ import annotations

import asyncio
import threading
from contextlib import AsyncExitStack
from types import SimpleNamespace

import pytest
from structlog.testing import capture_logs

from firstfix.errors import StoreUnavailable
from firstfix_service.thread_pools import background
from firstfix_service.thread_pools.background import PeriodicTask, close_within, run_in_background
from tests.waiting import LIMIT_S


@pytest.mark.parametrize("error", [StoreUnavailable("gone"), RuntimeError("a defect")])
def test_a_periodic_task_runs_again_after_a_failure(error: Exception):
    runs: list[int] = []

    async def main() -> None:
        third = asyncio.Event()

        async def work() -> None:
            runs.append(len(runs))
            if len(runs) == 3:
                third.set()
            raise error

        async with AsyncExitStack() as stack:
            PeriodicTask("count", work, 0.0).start(stack)
            await asyncio.wait_for(third.wait(), LIMIT_S)

    with capture_logs() as lines:
        asyncio.run(main())
    assert runs[:3] == [0, 1, 2]
    assert lines[0]["event"] == "a periodic task failed"
    assert lines[0]["task"] == "count"


def test_the_first_run_of_a_periodic_task_can_wait(monkeypatch: pytest.MonkeyPatch):
    pauses: list[float] = []
    here = threading.get_ident()

    async def sleep(seconds: float) -> None:
        if threading.get_ident() != here:  # a service of another test, whose tasks take the name there too
            await asyncio.sleep(seconds)
            return
        pauses.append(seconds)
        if len(pauses) == 3:
            raise asyncio.CancelledError

    async def work() -> None:
        pauses.append(-1.0)

    async def main() -> None:
        with pytest.raises(asyncio.CancelledError):
            await PeriodicTask("count", work, 60.0, first_after_s=300.0).run()

    monkeypatch.setattr(background, "asyncio", SimpleNamespace(**{**vars(asyncio), "sleep": sleep}))
    asyncio.run(main())
    assert pauses == [300.0, -1.0, 60.0]


def test_the_stack_waits_for_the_end_of_its_background_tasks():
    seen: list[str] = []

    async def main() -> None:
        begun = asyncio.Event()

        async def work() -> None:
            begun.set()
            try:
                await asyncio.Event().wait()
            finally:
                await asyncio.sleep(0)
                seen.append("ended")

        async with AsyncExitStack() as stack:
            run_in_background(stack, work(), "wait")
            await asyncio.wait_for(begun.wait(), LIMIT_S)
        seen.append("closed")

    asyncio.run(main())
    assert seen == ["ended", "closed"]


def test_a_part_that_does_not_close_does_not_hold_up_the_stop():
    gate, closed = threading.Event(), []

    async def main() -> None:
        async with AsyncExitStack() as stack:
            close_within(stack, lambda: closed.append("next"), LIMIT_S, "next")
            close_within(stack, lambda: closed.append(gate.wait(LIMIT_S)), 0.05, "hanging")
        assert closed == ["next"]

    with capture_logs() as lines:
        asyncio.run(main())
    gate.set()
    assert [line["part"] for line in lines] == ["hanging"]
