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
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import CorruptVersion, DeadlineExceeded, MalformedData, WorkerLost
from firstfix.transform import pose_error
from firstfix.wire.scan import MEDIA_TYPE, encode_scan
from firstfix_service.query_workers.body_format import BodyFormat
from firstfix_service.query_workers.protocol import INLINE_BYTES
from firstfix_service.query_workers.processes import QueryWorkerProcesses
from firstfix_service.query_workers.query import Query, ServedVersion
from waiting import LIMIT_S, let_pass, wait_until, wait_until_async

pytestmark = pytest.mark.slow

FORMAT = BodyFormat.of(MEDIA_TYPE, None)


@pytest.fixture(scope="module")
def yard(small_version) -> ServedVersion:
    return ServedVersion("yard", "1" * 64, small_version.directory)


@pytest.fixture(scope="module")
def shared_workers() -> Iterator[QueryWorkerProcesses]:
    running = QueryWorkerProcesses(2, query_timeout_s=30, max_body_bytes=1 << 26)
    try:
        yield running
    finally:
        running.close()


@pytest.fixture
def workers(shared_workers: QueryWorkerProcesses, yard: ServedVersion) -> QueryWorkerProcesses:
    """Two processes that are up and have loaded the yard: the same for all tests, or their replacements."""
    wait_until(lambda: len(shared_workers.pids) == 2)
    shared_workers.load(yard)
    return shared_workers


@pytest.fixture
def query(yard: ServedVersion, small_scans) -> Query:
    body = encode_scan(small_scans[0][0])
    return Query(body, FORMAT, LocalizeOptions(), (yard,), 1 << 28)


def asked(workers: QueryWorkerProcesses, query: Query) -> Localization:
    return Localization.from_mapping(json.loads(asyncio.run(workers.answer(query)).json))


def right(answer, truth) -> bool:
    return bool(answer.hypotheses) and pose_error(truth, answer.hypotheses[0].T_map_sensor)[0] < 0.2


def gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_it_answers_as_the_localizer_does(workers: QueryWorkerProcesses, query: Query, small_scans, yard):
    answers = [
        asked(workers, Query(encode_scan(scan), FORMAT, query.options, (yard,), 1 << 28))
        for scan, _ in small_scans[:8]
    ]
    found = [right(answer, truth) for answer, (_, truth) in zip(answers, small_scans, strict=False)]
    assert sum(found) >= 6
    assert {(answer.map_id, answer.map_version) for answer in answers} == {("yard", yard.version)}
    assert "decode" in answers[0].timings_ms


def test_the_callers_errors_come_back_as_they_are(workers: QueryWorkerProcesses, query: Query, yard):
    with pytest.raises(MalformedData):
        asked(workers, Query(b"no scan", FORMAT, query.options, (yard,), 1 << 28))
    assert asked(workers, query).map_id == "yard"


def test_a_version_that_cannot_be_loaded_is_refused_and_forgotten(
    workers: QueryWorkerProcesses, query: Query, tmp_path
):
    bad = ServedVersion("bad", "2" * 64, tmp_path)
    with pytest.raises(CorruptVersion):
        workers.load(bad)
    pids = workers.pids
    assert asked(workers, query).map_id == "yard"
    assert workers.pids == pids


def test_queries_survive_kills(workers: QueryWorkerProcesses, query: Query):
    """Repeated kills of idle and busy workers: a query is answered, or fails as lost with its worker."""
    end = threading.Event()

    def ask() -> tuple[int, int]:
        good = lost = 0
        while not end.is_set():
            try:
                assert asked(workers, query).map_id == "yard"
                good += 1
            except WorkerLost:
                lost += 1
        return good, lost

    with ThreadPoolExecutor(2) as threads:
        asking = [threads.submit(ask) for _ in range(2)]
        killed = set()
        for k in range(4):
            wait_until(lambda: len(workers.pids) == 2)
            pid = workers.pids[k % 2]
            os.kill(pid, signal.SIGKILL)
            killed.add(pid)
            let_pass(0.5)  # at work again, or on the way there
        end.set()
        outcomes = [one.result(LIMIT_S) for one in asking]
    assert sum(good for good, _ in outcomes) > 0
    wait_until(lambda: len(workers.pids) == 2)
    assert not killed & set(workers.pids)
    assert asked(workers, query).map_id == "yard", "the new ones know the version"


def test_a_worker_that_is_stuck_is_killed_and_replaced(query: Query, yard):
    deaths = []
    workers = QueryWorkerProcesses(
        1, query_timeout_s=1.5, max_body_bytes=1 << 26, on_death=lambda: deaths.append(1)
    )
    try:
        workers.load(yard)
        (stuck,) = workers.pids
        os.kill(stuck, signal.SIGSTOP)
        with pytest.raises(DeadlineExceeded):
            asked(workers, query)
        wait_until(lambda: gone(stuck) and workers.pids)
        wait_until(lambda: deaths == [1])
        wait_until(lambda: _answers(workers, query))
    finally:
        workers.close()


def _answers(workers: QueryWorkerProcesses, query: Query) -> bool:
    try:
        return asked(workers, query).map_id == "yard"
    except DeadlineExceeded:  # it was still starting
        return False


def test_a_worker_killed_with_a_long_body_loses_and_leaks_nothing(small_scans, yard: ServedVersion):
    """The body that the dead worker had in its memory is written anew into the memory of another one."""
    scan, _ = small_scans[0]
    body = scan.points.astype("<f4").tobytes() + bytes(12) * 4000  # points at the sensor, which are cropped
    assert len(body) > INLINE_BYTES
    query = Query(
        body, BodyFormat.of("application/vnd.firstfix.xyz", None), LocalizeOptions(), (yard,), 1 << 28
    )
    before = _bodies_mapped(os.getpid())
    workers = QueryWorkerProcesses(1, query_timeout_s=LIMIT_S, max_body_bytes=1 << 26)
    try:
        workers.load(yard)
        (first,) = workers.pids
        usual = asked(workers, query)
        os.kill(first, signal.SIGSTOP)
        with ThreadPoolExecutor(1) as threads:
            asking = threads.submit(asked, workers, query)
            wait_until(lambda: not workers._idle._idle)  # it was given to the worker
            os.kill(first, signal.SIGKILL)
            again = asking.result(LIMIT_S)
        assert again.verdict is usual.verdict
        poses = [answer.hypotheses[0].T_map_sensor for answer in (again, usual)]
        np.testing.assert_allclose(*poses, atol=1e-9)
        wait_until(lambda: _bodies_mapped(os.getpid()) == before + 1)
        assert [_bodies_mapped(pid) for pid in workers.pids] == [1], "its own, and no other worker's"
    finally:
        workers.close()
    assert _bodies_mapped(os.getpid()) == before


def test_a_reply_that_nobody_waited_for_answers_no_other_query(query: Query, yard: ServedVersion):
    workers = QueryWorkerProcesses(1, query_timeout_s=LIMIT_S, max_body_bytes=1 << 26)
    try:
        workers.load(yard)
        (first,) = workers.pids
        os.kill(first, signal.SIGSTOP)

        async def give_up() -> None:
            asking = asyncio.ensure_future(workers.answer(query))
            await wait_until_async(lambda: not workers._idle._idle)
            asking.cancel()
            with pytest.raises(asyncio.CancelledError):
                await asking

        asyncio.run(give_up())
        wait_until(lambda: gone(first) and workers.pids)
        with pytest.raises(MalformedData):
            asked(workers, Query(b"no scan", FORMAT, query.options, (yard,), 1 << 28))
    finally:
        workers.close()


def _bodies_mapped(pid: int) -> int:
    return Path(f"/proc/{pid}/maps").read_text().count("firstfix-bodies")


def test_workers_ignore_the_signals_that_are_meant_for_the_service(
    workers: QueryWorkerProcesses, query: Query
):
    pids = workers.pids
    for pid in pids:
        os.kill(pid, signal.SIGINT)
        os.kill(pid, signal.SIGTERM)
    assert asked(workers, query).map_id == "yard"
    assert workers.pids == pids


def test_closing_ends_the_processes(yard):
    workers = QueryWorkerProcesses(2, query_timeout_s=30, max_body_bytes=1 << 26)
    workers.load(yard)
    pids = workers.pids
    workers.close()
    assert workers.pids == []
    assert all(gone(pid) for pid in pids)


def test_workers_end_with_a_killed_service():
    code = """
import sys, time
from firstfix_service.query_workers.protocol import INLINE_BYTES
from firstfix_service.query_workers.processes import QueryWorkerProcesses
workers = QueryWorkerProcesses(2, query_timeout_s=30, max_body_bytes=1 << 26)
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
    wait_until(lambda: all(gone(pid) for pid in pids))
