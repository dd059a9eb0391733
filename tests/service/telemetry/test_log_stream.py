"""The log's stream: its reader may stop, and nobody who writes waits for it."""

from __future__ import annotations

import os
import threading

import pytest

from firstfix_service.telemetry import request_scope
from firstfix_service.telemetry.request_scope import MAX_BYTES, LogStream
from tests.waiting import LIMIT_S, wait_until


@pytest.fixture
def pipe() -> tuple[int, int]:
    return os.pipe()


def read_all(descriptor: int) -> list[str]:
    """Until the other end is closed."""
    with open(descriptor, "rb") as file:
        return file.read().decode().splitlines()


def test_lines_come_whole_and_in_order(pipe: tuple[int, int]):
    stream = LogStream(pipe[1])
    threads = [
        threading.Thread(target=lambda k=k: [stream.write(f"{k} {n}\n") for n in range(200)])
        for k in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    stream.drain(LIMIT_S)
    os.close(pipe[1])
    lines = [line.split() for line in read_all(pipe[0])]
    for k in range(4):
        assert [int(n) for one, n in lines if one == str(k)] == list(range(200))


def test_a_reader_who_stopped_holds_up_no_writer(pipe: tuple[int, int]):
    stream = LogStream(pipe[1])
    line = "x" * 9_999 + "\n"
    for _ in range(2 * MAX_BYTES // len(line)):  # the pipe takes 64 kB
        stream.write(line)
    read: list[str] = []
    reading = threading.Thread(target=lambda: read.extend(read_all(pipe[0])))
    reading.start()
    stream.drain(LIMIT_S)
    os.close(pipe[1])
    reading.join()
    told = [one for one in read if one != line.rstrip()]
    assert len(told) == 1
    assert "log lines were lost" in told[0]
    kept = len(read) - 1
    assert MAX_BYTES // len(line) <= kept < 2 * MAX_BYTES // len(line)


def test_a_drain_ends_although_nobody_reads(pipe: tuple[int, int]):
    stream = LogStream(pipe[1])
    stream.write("x" * (1 << 20))
    stream.drain(0.1)
    reading = threading.Thread(target=read_all, args=(pipe[0],))
    reading.start()
    stream.drain(LIMIT_S)
    os.close(pipe[1])
    reading.join()


def test_a_reader_who_has_gone_ends_nothing(pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch):
    tried: list[int] = []

    def fail(descriptor: int, data: memoryview) -> int:
        tried.append(len(data))
        raise BrokenPipeError

    monkeypatch.setattr(request_scope.os, "write", fail)
    stream = LogStream(pipe[1])
    stream.write("one\n")
    wait_until(lambda: len(tried) == 1)
    stream.write("two\n")
    wait_until(lambda: len(tried) == 2)
    stream.drain(LIMIT_S)
    monkeypatch.undo()
    for end in pipe:
        os.close(end)
