"""Answers that are made once for each state of what they tell of."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from firstfix_service.http_api.made_once import MadeOnce


@dataclass(frozen=True)
class Made:
    number: int
    size_bytes: int = 1


class Maker:
    """Counts what it makes."""

    def __init__(self, size_bytes: int = 1) -> None:
        self.count, self.size_bytes = 0, size_bytes

    def __call__(self) -> Made:
        self.count += 1
        return Made(self.count, self.size_bytes)


def test_one_is_made_for_each_key_and_state():
    kept: MadeOnce[Made] = MadeOnce(10, 100)
    make = Maker()
    found = [kept.of(key, state, make).number for key, state in (("a", 1), ("a", 1), ("b", 1), ("a", 2))]
    assert found == [1, 1, 2, 3]
    assert kept.of("b", 1, make).number == 2
    assert kept.of("a", 2, make).number == 3


def test_those_who_ask_at_the_same_time_share_one():
    kept: MadeOnce[Made] = MadeOnce(10, 100)
    make, together = Maker(), threading.Barrier(4)

    def ask(_: int) -> int:
        together.wait()
        return kept.of("a", 1, make).number

    with ThreadPoolExecutor(4) as threads:
        assert set(threads.map(ask, range(4))) == {1}


@pytest.mark.parametrize(("most", "max_bytes"), [(2, 100), (10, 70)])
def test_those_not_used_for_longest_are_dropped(most: int, max_bytes: int):
    kept: MadeOnce[Made] = MadeOnce(most, max_bytes)
    make = Maker(size_bytes=30)
    for key in ("a", "b", "a", "c"):
        kept.of(key, 1, make)
    assert make.count == 3
    kept.of("a", 1, make)
    assert make.count == 3
    kept.of("b", 1, make)
    assert make.count == 4


def test_one_that_is_too_large_is_kept_alone():
    kept: MadeOnce[Made] = MadeOnce(10, 10)
    make = Maker(size_bytes=30)
    for _ in range(3):
        kept.of("a", 1, make)
    assert make.count == 1


def test_after_an_error_it_is_made_again():
    kept: MadeOnce[Made] = MadeOnce(10, 10)

    def fail() -> Made:
        raise OSError("no store")

    with pytest.raises(OSError, match="no store"):
        kept.of("a", 1, fail)
    assert kept.of("a", 1, Maker()).number == 1
