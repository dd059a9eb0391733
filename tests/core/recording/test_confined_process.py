"""A process with limits: what crashes, hangs or grows in it ends it, and the next job has a new one."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Generator

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.recording.confined_process import ConfinedProcess, Limits
from tests.every_case import every_case


def double(value: int) -> int:
    return 2 * value


def process_id() -> int:
    return os.getpid()


def crash() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def burn() -> None:
    while True:
        pass


def sleep() -> None:
    time.sleep(1e6)


def fill() -> int:
    return int(np.ones(1 << 31, np.uint8).sum())


def refuse() -> None:
    raise UnsupportedFormat("of another model")


def raise_others() -> None:
    raise ZeroDivisionError("by 0")


def need() -> None:
    raise ModuleNotFoundError("pip install it", name="it")


def sums(first: int) -> Generator[int, int | None, None]:
    """Yields the sum of what is sent, until None is."""
    total = first
    while True:
        sent = yield total
        if sent is None:
            return
        total += sent


@pytest.fixture
def process() -> Generator[ConfinedProcess, None, None]:
    made = ConfinedProcess(Limits(memory_bytes=1 << 30, processor_s=2, wait_s=60))
    yield made
    made.close()


ENDS = {"crash": crash, "burn": burn}


def test_what_ends_the_process_is_malformed_and_the_next_job_has_a_new_one(process: ConfinedProcess):
    before = process.run(process_id)
    assert before not in (os.getpid(), None)
    for function in ENDS.values():
        with pytest.raises(MalformedData, match="crashed, or took more than 2 s of processor time"):
            process.run(function)
        after = process.run(process_id)
        assert after != before
        before = after
    assert process.run(double, 4) == 8


def test_what_waits_for_ever_is_ended():
    process = ConfinedProcess(Limits(wait_s=0.2))
    with pytest.raises(MalformedData, match="took more than"):
        process.run(sleep)
    process.close()


@every_case("function, error, said", [(fill, TooLarge, "memory"), (refuse, UnsupportedFormat, "of another")])
def test_errors_pass(function, error, said: str):
    process = ConfinedProcess(Limits(memory_bytes=1 << 30))
    with pytest.raises(error, match=said):
        process.run(function)
    with pytest.raises(MalformedData, match="by 0"):
        process.run(raise_others)
    with pytest.raises(ModuleNotFoundError) as missing:
        process.run(need)
    assert missing.value.name == "it"
    process.close()


def test_two_talks_go_on_beside_each_other_and_end(process: ConfinedProcess):
    first, second = process.talk(sums, 1), process.talk(sums, 100)
    assert [first.send(), second.send(), first.send(5), second.send(6), first.send(1)] == [1, 100, 6, 106, 7]
    with pytest.raises(StopIteration):
        first.send(None)
    assert second.send(1) == 107
    with pytest.raises(MalformedData, match="crashed"):
        process.run(crash)
    with pytest.raises(MalformedData, match="its reader has ended"):
        second.send(1)


def test_the_process_ends_with_its_owner():
    process = ConfinedProcess()
    number = process.run(process_id)
    del process
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)
