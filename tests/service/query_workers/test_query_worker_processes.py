"""Real worker processes with a real version: killed, stopped, orphaned, and with bad versions."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.warm_up import VIEWPOINTS
from firstfix.errors import CorruptVersion, DeadlineExceeded, MalformedData, QueryCancelled, TooLarge
from firstfix.transform import pose_error
from firstfix.wire.scan import MEDIA_TYPE, encode_scan
from firstfix_service.limits.limits import Limits
from firstfix_service.localize.query_gate import QueryGate
from firstfix_service.query_workers.processes import QueryWorkerProcesses
from firstfix_service.query_workers.protocol import INLINE_BYTES
from firstfix_service.query_workers.query import BodyFormat, EncodedAnswer, Query, ServedVersion
from tests.service.builds_world import is_alive
from tests.waiting import LIMIT_S, wait_until


@pytest.fixture(scope="module")
def yard(small_version) -> ServedVersion:
    return ServedVersion("yard", "1" * 64, small_version.directory)


class Answering:
    """Worker processes behind a gate, in an event loop of their own."""

    def __init__(self, count: int, **more: Any) -> None:
        self.loop = asyncio.new_event_loop()
        threading.Thread(target=self.loop.run_forever, daemon=True).start()
        self.gate = self._run(self._gate(count))
        values = {"query_timeout_s": 30, "max_body_bytes": 1 << 26, **more}
        self.processes = QueryWorkerProcesses(count, on_up=self.gate.add_worker, **values)

    @property
    def pids(self) -> list[int]:
        return self.processes.pids

    def ask(self, query: Query) -> Localization:
        return Localization.from_mapping(json.loads(self._run(self._answer(query)).json))

    def __enter__(self) -> Answering:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._run(self.gate.close())
        self.processes.close()
        self.loop.call_soon_threadsafe(self.loop.stop)

    async def _gate(self, count: int) -> QueryGate:
        return QueryGate(Limits(workers=count, queue_size=8))

    async def _answer(self, query: Query) -> EncodedAnswer:
        done: Future[Any] = Future()
        done.set_result(SimpleNamespace(close=lambda: None))
        return await self.gate.run(query.asker, lambda: done, lambda *_: query)

    def _run(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(LIMIT_S)


@pytest.fixture(scope="module")
def shared_workers() -> Iterator[Answering]:
    with Answering(2) as running:
        yield running


@pytest.fixture
def workers(shared_workers: Answering, yard: ServedVersion) -> Answering:
    """Two processes that are up and have loaded the yard: the same for all tests, or their replacements."""
    wait_until(lambda: len(shared_workers.pids) == 2)
    shared_workers.processes.load(yard)
    return shared_workers


def query_of(yard: ServedVersion, body: bytes, media_type: str = MEDIA_TYPE) -> Query:
    body_format = BodyFormat.of(media_type, None)
    return Query(("yard",), LocalizeOptions(), body_format, body=body, versions=(yard,))


@pytest.fixture
def query(yard: ServedVersion, small_scans) -> Query:
    return query_of(yard, encode_scan(small_scans[0][0]))


def right(answer, truth) -> bool:
    return bool(answer.hypotheses) and pose_error(truth, answer.hypotheses[0].T_map_sensor)[0] < 0.2


def test_answers_are_those_of_the_localizer(workers: Answering, query: Query, small_scans, yard):
    answers = [workers.ask(query_of(yard, encode_scan(scan))) for scan, _ in small_scans[:8]]
    found = [right(answer, truth) for answer, (_, truth) in zip(answers, small_scans, strict=False)]
    assert sum(found) >= 6
    assert {(answer.map_id, answer.map_version) for answer in answers} == {("yard", yard.version)}
    assert "decode" in answers[0].timings_ms


def test_every_process_warms_up_a_version_once(yard: ServedVersion, query: Query):
    with Answering(2) as answering:
        wait_until(lambda: len(answering.pids) == 2)  # one that starts later warms up by itself
        answering.processes.load(yard)
        assert 0 < answering.processes.warm_up(yard) <= 2 * VIEWPOINTS  # a slow machine has time for fewer
        assert answering.processes.warm_up(yard) == 0
        answering.processes.drop(yard)
        assert answering.processes.warm_up(yard) == 0
        assert answering.ask(query).map_id == "yard"


def test_a_warm_up_that_fails_says_so_and_the_process_goes_on(yard: ServedVersion):
    with Answering(1, max_body_bytes=4096) as answering:  # the map's own scans are longer
        answering.processes.load(yard)
        pids = answering.pids
        with pytest.raises(TooLarge):
            answering.processes.warm_up(yard)
        with pytest.raises(MalformedData):
            answering.ask(query_of(yard, b"no scan"))
        assert answering.pids == pids


def test_errors_of_callers_come_back_unchanged(workers: Answering, query: Query, yard):
    with pytest.raises(MalformedData):
        workers.ask(query_of(yard, b"no scan"))
    assert workers.ask(query).map_id == "yard"


def test_a_version_that_cannot_be_loaded_is_refused_and_forgotten(workers: Answering, query: Query, tmp_path):
    bad = ServedVersion("bad", "2" * 64, tmp_path)
    with pytest.raises(CorruptVersion):
        workers.processes.load(bad)
    pids = workers.pids
    assert workers.ask(query).map_id == "yard"
    assert workers.pids == pids


def test_a_stuck_worker_is_killed_and_replaced(query: Query, yard):
    deaths = []
    with Answering(1, query_timeout_s=1.5, on_death=lambda: deaths.append(1)) as workers:
        workers.processes.load(yard)
        (stuck,) = workers.pids
        os.kill(stuck, signal.SIGSTOP)
        with pytest.raises(DeadlineExceeded):
            workers.ask(query)
        wait_until(lambda: not is_alive(stuck) and workers.pids)
        wait_until(lambda: deaths == [1])
        wait_until(lambda: _answers(workers, query))


def _answers(workers: Answering, query: Query) -> bool:
    try:
        return workers.ask(query).map_id == "yard"
    except DeadlineExceeded:  # it was still starting
        return False


def test_a_query_of_a_killed_worker_is_answered_without_a_leak(small_scans, yard: ServedVersion):
    """The body that the dead worker had in its memory is written anew into the memory of another one."""
    scan, _ = small_scans[0]
    body = scan.points.astype("<f4").tobytes() + bytes(12) * 4000  # points at the sensor, which are cropped
    assert len(body) > INLINE_BYTES
    query = query_of(yard, body, "application/vnd.firstfix.xyz")
    before = _bodies_mapped(os.getpid())
    with Answering(1, query_timeout_s=LIMIT_S) as workers:
        workers.processes.load(yard)
        (first,) = workers.pids
        usual = workers.ask(query)
        os.kill(first, signal.SIGSTOP)
        with ThreadPoolExecutor(1) as threads:
            asking = threads.submit(workers.ask, query)
            wait_until(lambda: not workers.gate._free)  # it was given to the worker
            os.kill(first, signal.SIGKILL)
            again = asking.result(LIMIT_S)
        assert again.verdict is usual.verdict
        poses = [answer.hypotheses[0].T_map_sensor for answer in (again, usual)]
        np.testing.assert_allclose(*poses, atol=1e-9)
        wait_until(lambda: _bodies_mapped(os.getpid()) == before + 1)
        assert [_bodies_mapped(pid) for pid in workers.pids] == [1], "its own, and no other worker's"
    assert _bodies_mapped(os.getpid()) == before


def test_a_worker_that_dies_while_it_waits_leaves_no_socket(query: Query, yard: ServedVersion):
    with Answering(1) as workers:
        workers.processes.load(yard)
        assert workers.ask(query).map_id == "yard"
        (first,), before = workers.pids, _open_sockets()
        os.kill(first, signal.SIGKILL)
        wait_until(lambda: workers.pids and workers.pids != [first])
        wait_until(lambda: _open_sockets() == before)
        assert workers.ask(query).map_id == "yard"


def _open_sockets() -> int:
    found = 0
    for file in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):
            found += str(file.readlink()).startswith("socket:")
    return found


def test_a_late_reply_does_not_answer_another_query(query: Query, yard: ServedVersion):
    with Answering(1, query_timeout_s=LIMIT_S) as workers:
        workers.processes.load(yard)
        (first,) = workers.pids
        wait_until(lambda: workers.gate._free)
        worker = workers.gate._free.pop()
        os.kill(first, signal.SIGSTOP)

        async def give_up() -> None:
            asking = asyncio.ensure_future(worker.answer(query))
            await asyncio.sleep(0)  # it was given to the worker
            asking.cancel()
            with pytest.raises(asyncio.CancelledError):
                await asking

        asyncio.run(give_up())
        wait_until(lambda: not is_alive(first) and workers.pids)
        with pytest.raises(MalformedData):
            workers.ask(query_of(yard, b"no scan"))


def test_a_query_is_cancelled_in_its_process_and_no_other_is(workers: Answering, query: Query):
    """The process finds the query and its cancellation together, when it goes on."""
    wait_until(lambda: len(workers.gate._free) == 2)
    worker = workers.gate._free.pop()
    pid = worker.pid

    async def ask(*, is_cancelled: bool) -> Localization:
        asking = worker.answer(query)
        if is_cancelled:
            worker.cancel(asking)
        os.kill(pid, signal.SIGCONT)
        return Localization.from_mapping(json.loads((await asking).json))

    try:
        wanted = workers._run(ask(is_cancelled=False))
        for _ in range(3):
            os.kill(pid, signal.SIGSTOP)
            with pytest.raises(QueryCancelled):
                workers._run(ask(is_cancelled=True))
            again = workers._run(ask(is_cancelled=False))
            assert again.verdict is wanted.verdict
            assert np.array_equal(again.T_map_sensor, wanted.T_map_sensor)

        async def cancel_an_answered_one() -> None:
            asking = worker.answer(query)
            await asking
            worker.cancel(asking)

        workers._run(cancel_an_answered_one())
        assert workers._run(ask(is_cancelled=False)).verdict is wanted.verdict
        assert pid in workers.pids
    finally:
        workers.gate.add_worker(worker)


def _bodies_mapped(pid: int) -> int:
    return Path(f"/proc/{pid}/maps").read_text().count("firstfix-bodies")


def test_workers_ignore_the_signals_that_are_meant_for_the_service(workers: Answering, query: Query):
    pids = workers.pids
    for pid in pids:
        os.kill(pid, signal.SIGINT)
        os.kill(pid, signal.SIGTERM)
    assert workers.ask(query).map_id == "yard"
    assert workers.pids == pids


def test_closing_ends_the_processes(yard):
    workers = Answering(2)
    workers.processes.load(yard)
    pids = workers.pids
    workers.close()
    assert workers.pids == []
    assert all(not is_alive(pid) for pid in pids)


def test_workers_end_with_a_killed_service():
    code = """
import sys, time
from firstfix_service.query_workers.processes import QueryWorkerProcesses
workers = QueryWorkerProcesses(
    2, on_up=lambda worker: None, query_timeout_s=30, max_body_bytes=1 << 26
)
while len(workers.pids) < 2:
    time.sleep(0.02)
print(*workers.pids, flush=True)
time.sleep(3600)
"""
    service = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert service.stdout is not None
    pids = [int(pid) for pid in service.stdout.readline().split()]
    assert len(pids) == 2
    service.kill()
    service.wait()
    wait_until(lambda: all(not is_alive(pid) for pid in pids))


def test_a_query_worker_starts_without_what_it_may_never_need():
    code = "import sys, firstfix_service.query_workers.worker; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 0, done.stderr
    packages = {name.partition(".")[0] for name in done.stdout.split()}
    assert "firstfix" in packages
    assert not {"scipy", "faiss"} & packages, "a version that needs one brings it"
