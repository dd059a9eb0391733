"""Attempts at a build: one claimant at a time, failures counted by stage, nothing lost by a kill."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pytest

from firstfix.builds.attempts import LOST_PER_FAILURE, Attempt, AttemptEnd, BuildAttempts, has_open_attempt
from firstfix.builds.records import new_status
from firstfix.errors import BuildAttemptsExceeded
from firstfix.store.store import Store
from tests.core.fixtures import at_once
from tests.waiting import let_pass, wait_until

LONG_S, SHORT_S = 3000.0, 3.0  # leases: one that does not run out in a test, and one that does


@pytest.fixture
def store(any_store_url: str) -> Store:
    return Store.open(any_store_url)


def attempts(store: Store, holder: str, lease_s: float = LONG_S, max_attempts: int = 3) -> BuildAttempts:
    return BuildAttempts(store, holder, lease_s=lease_s, max_attempts=max_attempts)


def at(stage: str = "", progress: float = 0.0, state: str = "running") -> Mapping[str, Any]:
    return new_status(state, map_id="hall", stage=stage, progress=progress)


def test_a_build_has_one_holder_until_it_ends(store: Store):
    one, two = attempts(store, "one"), attempts(store, "two")
    assert not has_open_attempt(store, "b1")
    first = one.claim("b1", at())
    assert first.number == 1
    assert has_open_attempt(store, "b1")
    assert two.claim("b1", at()) is None
    assert one.beat(first)
    one.end(first, AttemptEnd.STOPPED)
    assert not has_open_attempt(store, "b1")
    second = two.claim("b1", at())
    assert second.number == 2
    assert not one.beat(first), "its turn is over"
    assert two.beat(second)


def test_one_of_many_claimants_gets_a_build(store: Store):
    claims = at_once(8, lambda i: attempts(store, f"holder{i}").claim("b1", at()))
    assert claims.count(None) == 7


def test_a_holder_that_restarts_gets_its_build_at_once(store: Store):
    assert attempts(store, "one").claim("b1", at()) is not None
    again = attempts(store, "one").claim("b1", at("cluster"))
    assert again.number == 2


def test_a_silent_holder_loses_the_build(store: Store):
    one, two = attempts(store, "one", SHORT_S), attempts(store, "two", SHORT_S)
    first = one.claim("b1", at())
    for _ in range(15):
        assert one.beat(first)
        assert two.claim("b1", at("cluster")) is None, "it is heard of"
        let_pass(SHORT_S / 10)
    taken: list[Attempt | None] = [None]

    def take() -> Attempt | None:
        taken.append(two.claim("b1", at("cluster")))
        return taken[-1]

    wait_until(take)
    assert taken[-1].number == 2
    assert not one.beat(first), "it hears of it"
    one.end(first, AttemptEnd.ENDED)  # too late
    ended = json.loads(store.get("builds/b1/attempts/000001.end.json"))
    assert (ended["end"], ended["stage"]) == ("lost", "cluster")
    assert "no heartbeat" in ended["why"]


def ended(store: Store, stage: str, progress: float, how: AttemptEnd = AttemptEnd.DIED) -> None:
    one = attempts(store, "one")
    attempt = one.claim("b1", at(stage, progress, "queued"))
    one.end(attempt, how, status=at(stage, progress), why="SIGKILL")


def test_three_deaths_without_progress_are_enough(store: Store):
    ended(store, "read_map", 0.1)
    ended(store, "read_map", 0.1)
    ended(store, "cluster", 0.5)  # further than before: the count begins again
    ended(store, "cluster", 0.5)
    for how in (AttemptEnd.STOPPED, AttemptEnd.NO_SPACE, AttemptEnd.ENDED):
        ended(store, "cluster", 0.5, how)  # not held against it
    ended(store, "read_map", 0.1)
    with pytest.raises(
        BuildAttemptsExceeded, match="3 attempts failed without progress; the last one in the stage read_map"
    ):
        attempts(store, "two").claim("b1", at("cluster"))
    assert attempts(store, "two").claim("b2", at()) is not None, "another build is another build"


@pytest.mark.parametrize(("state", "is_counted"), [("running", True), ("queued", False)])
def test_many_kills_of_the_holder_count_unless_the_builds_process_outlived_them(state: str, is_counted: bool):
    """Where the process was killed with its holder, or first, nobody can tell."""
    store = Store.open("memory://")
    for _ in range(3 * LOST_PER_FAILURE):
        assert attempts(store, "one").claim("b1", at("cluster", 0.5, state)) is not None
    if not is_counted:
        assert attempts(store, "one").claim("b1", at("cluster", 0.5, state)) is not None
        return
    with pytest.raises(BuildAttemptsExceeded, match="the process that ran the build worker ended"):
        attempts(store, "one").claim("b1", at("cluster", 0.5))
    assert not has_open_attempt(store, "b1")


def test_only_the_last_ends_without_space_are_counted(store: Store):
    one = attempts(store, "one")
    ended(store, "publish", 0.9, AttemptEnd.NO_SPACE)
    ended(store, "publish", 0.9, AttemptEnd.STOPPED)
    assert one.times_without_space("b1") == 0
    for times in (1, 2):
        ended(store, "publish", 0.9, AttemptEnd.NO_SPACE)
        assert one.times_without_space("b1") == times


def test_an_attempt_that_ended_leaves_its_record_alone(store: Store):
    one = attempts(store, "one")
    attempt = one.claim("b1", at())
    assert attempts(store, "two").claim("b1", at()) is None
    one.end(attempt, AttemptEnd.ENDED)
    assert store.list("builds") == [f"builds/b1/attempts/000001{end}" for end in (".end.json", ".json")]
