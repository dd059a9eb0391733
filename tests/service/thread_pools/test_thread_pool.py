"""Thread pools: slow work has threads of its own, so that no request, key or build waits for it."""

from __future__ import annotations

import ast
import asyncio
import inspect
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from pathlib import Path

import httpx
import pytest
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute, iter_route_contexts

import firstfix_service
from firstfix.access.api_keys import ApiKeys
from firstfix.errors import Overloaded, StoreUnavailable
from firstfix_service.app import create_app
from firstfix_service.http_api.bodies import submission
from firstfix_service.settings import Settings
from firstfix_service.telemetry.request_scope import Requests, note
from firstfix_service.thread_pools import BUILDS, ThreadPool
from tests.service.access_world import get, give
from tests.service.service_world import Service, running_service
from tests.waiting import LIMIT_S, wait_until

SOURCES = sorted(Path(firstfix_service.__file__).parent.rglob("*.py"))
SHARED = {"to_thread", "run_in_threadpool", "run_sync", "set_default_executor"}
SLOW_POSTS = 40  # more than the threads of any shared pool


def test_nothing_runs_in_an_executor_that_everybody_shares():
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            name = getattr(node, "attr", getattr(node, "id", None))
            assert name not in SHARED, f"{path.name}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "run_in_executor":
                assert not (isinstance(node.args[0], ast.Constant) and node.args[0].value is None), path.name


def called(dependant: Dependant) -> list[Callable[..., object]]:
    below = [call for dependency in dependant.dependencies for call in called(dependency)]
    return below if dependant.call is None else [dependant.call, *below]


def test_no_route_runs_in_the_threads_of_the_framework():
    app = create_app(Settings(store="memory://"))
    for route in iter_route_contexts(app.routes):
        if isinstance(route.original_route, APIRoute):
            for call in called(route.dependant):
                assert inspect.iscoroutinefunction(call), f"{route.name}: {call}"


async def as_caller(name: str, pool: ThreadPool, work: Callable[[], object]) -> object:
    with Requests().scope("http", None, request_id="", traceparent=None, started=time.monotonic()):
        note(caller=name)
        return await pool.run(work)


def test_one_caller_never_has_all_threads():
    pool, gate = ThreadPool("test", 3), threading.Event()

    async def main() -> None:
        greedy = [
            asyncio.create_task(as_caller("greedy", pool, lambda: gate.wait(LIMIT_S))) for _ in range(10)
        ]
        await asyncio.sleep(0)
        async with asyncio.timeout(LIMIT_S):
            assert await as_caller("other", pool, lambda: "done") == "done"
        gate.set()
        assert await asyncio.gather(*greedy) == [True] * 10

    asyncio.run(main())


def test_callers_take_turns():
    pool, order, gate = ThreadPool("test", 1), [], threading.Event()

    async def main() -> None:
        first = asyncio.create_task(pool.run(gate.wait, LIMIT_S))
        await asyncio.sleep(0)
        asked = [("a", 1), ("a", 2), ("a", 3), ("b", 1), ("b", 2)]
        tasks = [
            asyncio.create_task(as_caller(name, pool, lambda one=(name, n): order.append(one)))
            for name, n in asked
        ]
        await asyncio.sleep(0)
        gate.set()
        await asyncio.gather(first, *tasks)

    asyncio.run(main())
    assert order == [("a", 1), ("b", 1), ("a", 2), ("b", 2), ("a", 3)]


def test_work_runs_in_its_callers_context_and_raises_what_it_raises():
    name: ContextVar[str] = ContextVar("name")

    def fail() -> None:
        raise ValueError(name.get())

    async def main() -> None:
        name.set("here")
        with pytest.raises(ValueError, match="here"):
            await ThreadPool("test", 1).run(fail)

    asyncio.run(main())


def test_work_that_nobody_waits_for_any_more_is_not_begun():
    pool, gate, begun = ThreadPool("test", 1), threading.Event(), []

    async def main() -> None:
        first = asyncio.create_task(pool.run(gate.wait, LIMIT_S))
        given_up = asyncio.create_task(pool.run(begun.append, 1))
        await asyncio.sleep(0)
        given_up.cancel()
        await asyncio.sleep(0)
        gate.set()
        await first
        await pool.run(lambda: None)

    asyncio.run(main())
    assert begun == []


def test_a_request_waits_for_its_turn_only_so_long():
    pool, gate, begun = ThreadPool("test", 1, turn_within_s=0.05), threading.Event(), []

    async def main() -> None:
        hanging = asyncio.create_task(as_caller("first", pool, lambda: gate.wait(LIMIT_S)))
        await asyncio.sleep(0)
        async with asyncio.timeout(LIMIT_S):
            with pytest.raises(Overloaded, match="'test' waits: try again"):
                await as_caller("second", pool, lambda: begun.append(1))
        own = asyncio.create_task(pool.run(lambda: "the service's own work waits"))
        gate.set()
        assert await hanging is True, "work that has begun has no such limit"
        assert await own == "the service's own work waits"

    asyncio.run(main())
    assert begun == []


def test_requests_are_given_up_but_not_the_work_of_the_service():
    pool, gate = ThreadPool("test", 2), threading.Event()

    async def main() -> None:
        own = asyncio.create_task(pool.run(gate.wait, LIMIT_S))
        asked = [asyncio.create_task(as_caller("a", pool, lambda: gate.wait(LIMIT_S))) for _ in range(3)]
        cancelled = asyncio.create_task(as_caller("a", pool, lambda: gate.wait(LIMIT_S)))
        await asyncio.sleep(0)
        cancelled.cancel()
        pool.give_up_requests("the service is stopping")
        found = await asyncio.gather(*asked, cancelled, return_exceptions=True)
        assert [type(one) for one in found] == [Overloaded] * 3 + [asyncio.CancelledError]
        gate.set()
        assert await own is True

    asyncio.run(main())


def test_slow_maps_hold_up_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    copying, gate = threading.Semaphore(0), threading.Event()

    def slowly(*_: object, **__: object) -> str:
        copying.release()
        assert gate.wait(LIMIT_S)
        raise StoreUnavailable("the test has ended")

    monkeypatch.setattr(submission, "put_source", slowly)
    any_number = {"max_upload_streams": SLOW_POSTS, "max_upload_streams_per_caller": SLOW_POSTS}
    with (
        running_service(tmp_path, zenoh=False, auth="on", keys_refresh_s=0.1, **any_number) as service,
        ThreadPoolExecutor(SLOW_POSTS) as callers,
    ):
        service.catalog.builds.put("b1", {"map_id": "hall"})
        mine, other = give(service, "build"), give(service, "build", maps=("hall",))
        wait_until(lambda: get(service, "/builds/b1", other).is_success)
        posts = [callers.submit(post_slowly, service, mine) for _ in range(SLOW_POSTS)]
        try:
            for _ in range(2):
                assert copying.acquire(timeout=LIMIT_S)
            for path in ("/builds/b1", "/builds", "/maps", "/readyz"):
                assert get(service, path, other).is_success, path
            asyncio.run(asyncio.wait_for(BUILDS.run(lambda: None), LIMIT_S))
            ApiKeys(service.catalog.store).revoke(mine.split("_")[1])
            wait_until(lambda: get(service, "/builds/b1", mine).status_code == 401)
        finally:
            gate.set()
        for post in posts:
            post.result()


def post_slowly(service: Service, key: str) -> int:
    return httpx.post(
        f"{service.url}/maps",
        files={"source": ("a.ply", b"ply")},
        data={"map_id": "hall"},
        headers={"Authorization": f"Bearer {key}"},
        timeout=2 * LIMIT_S,
    ).status_code
