"""Attempts at a build: one claimant at a time, failures counted by stage, nothing lost by a kill."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from firstfix.builds.attempts import Attempt, AttemptEnd, BuildAttempts, has_open_attempt
from firstfix.errors import BuildAttemptsExceeded
from firstfix.store.store import Store
from waiting import let_pass, wait_until

pytestmark = pytest.mark.slow

LONG_S, SHORT_S = 3000.0, 3.0  # leases: one that does not run out in a test, and one that does


@pytest.fixture
def store(any_store_url: str) -> Store:
    return Store.open(any_store_url)


def attempts(store: Store, holder: str, lease_s: float = LONG_S, max_attempts: int = 3) -> BuildAttempts:
    return BuildAttempts(store, holder, lease_s=lease_s, max_attempts=max_attempts)


def test_a_build_is_one_holders_until_it_ends(store: Store) -> None:
    one, two = attempts(store, "one"), attempts(store, "two")
    assert not has_open_attempt(store, "b1")
    first = one.claim("b1", "")
    assert first is not None
    assert first.number == 1
    assert has_open_attempt(store, "b1")
    assert two.claim("b1", "") is None
    assert one.beat(first)
    one.end(first, AttemptEnd.STOPPED)
    assert not has_open_attempt(store, "b1")
    second = two.claim("b1", "")
    assert second is not None
    assert second.number == 2
    assert not one.beat(first), "its turn is over"
    assert two.beat(second)


def test_of_many_who_want_a_build_one_gets_it(store: Store) -> None:
    ready = threading.Barrier(8)

    def claim(i: int) -> object:
        ready.wait()
        return attempts(store, f"holder{i}").claim("b1", "")

    with ThreadPoolExecutor(8) as pool:
        assert sum(got is not None for got in pool.map(claim, range(8))) == 1


def test_what_a_holder_did_not_live_to_end_is_its_successors_at_once(store: Store) -> None:
    assert attempts(store, "one").claim("b1", "") is not None
    again = attempts(store, "one").claim("b1", "cluster")
    assert again is not None
    assert again.number == 2


def test_a_silent_holder_loses_the_build(store: Store) -> None:
    one, two = attempts(store, "one", SHORT_S), attempts(store, "two", SHORT_S)
    first = one.claim("b1", "")
    assert first is not None
    for _ in range(15):
        assert one.beat(first)
        assert two.claim("b1", "cluster") is None, "it is heard of"
        let_pass(SHORT_S / 10)
    taken: list[Attempt | None] = [None]

    def take() -> Attempt | None:
        taken.append(two.claim("b1", "cluster"))
        return taken[-1]

    wait_until(take)
    assert taken[-1] is not None
    assert taken[-1].number == 2
    assert not one.beat(first), "it hears of it"
    one.end(first, AttemptEnd.ENDED)  # too late
    with pytest.raises(BuildAttemptsExceeded, match=r"1 attempts failed in the stage cluster.*no heartbeat"):
        attempts(store, "two", max_attempts=1).claim("b1", "cluster")


def died(store: Store, stage: str, how: AttemptEnd = AttemptEnd.DIED) -> None:
    one = attempts(store, "one")
    attempt = one.claim("b1", stage)
    assert attempt is not None
    one.end(attempt, how, stage=stage, why="SIGKILL")


def test_three_deaths_in_one_stage_are_enough(store: Store) -> None:
    for stage in ("read_map", "cluster", "cluster", "read_map", "self_test"):
        died(store, stage)
    for how in (AttemptEnd.STOPPED, AttemptEnd.ENDED):
        died(store, "cluster", how)  # not held against it
    died(store, "cluster")
    with pytest.raises(BuildAttemptsExceeded, match="3 attempts failed in the stage cluster; the last"):
        attempts(store, "two").claim("b1", "cluster")
    assert attempts(store, "two").claim("b2", "") is not None, "another build is another build"


def test_a_kill_of_the_holder_counts(store: Store) -> None:
    for _ in range(3):
        assert attempts(store, "one").claim("b1", "cluster") is not None
    with pytest.raises(BuildAttemptsExceeded, match="the process that ran the build worker ended"):
        attempts(store, "one").claim("b1", "cluster")
    assert not has_open_attempt(store, "b1")


def test_nothing_but_the_record_is_left_of_an_attempt_that_ended(store: Store) -> None:
    one = attempts(store, "one")
    attempt = one.claim("b1", "")
    assert attempt is not None
    assert attempts(store, "two").claim("b1", "") is None
    one.end(attempt, AttemptEnd.ENDED)
    assert store.list("builds") == [
        "builds/b1/attempts/000001.end.json",
        "builds/b1/attempts/000001.json",
    ]
