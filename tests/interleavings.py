"""Two who use one store at once, in every order that matters: a switch before any call to the store."""

from __future__ import annotations

import itertools
import random
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import obstore
import pytest

from firstfix.store import backend, store

WAIT_S = 60.0


class Killed(BaseException):
    """Ends an actor in the middle of its work."""


class _Actor:
    def __init__(self, work: Callable[[], Any]) -> None:
        self._work = work
        self._go, self._reached = threading.Semaphore(0), threading.Semaphore(0)
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.failed: BaseException | None = None
        self.ended = self._killed = False

    def start(self) -> None:
        """Runs to its first call to the store."""
        self.thread.start()
        assert self._reached.acquire(timeout=WAIT_S)

    def step(self) -> None:
        """Makes the call that it stands before, and runs to the next one."""
        self._go.release()
        assert self._reached.acquire(timeout=WAIT_S)

    def kill(self) -> None:
        self._killed = True
        self.step()

    def before_call(self) -> None:
        self._reached.release()
        assert self._go.acquire(timeout=WAIT_S)
        if self._killed:
            raise Killed

    def _run(self) -> None:
        try:
            self._work()
        except Killed:
            pass
        except BaseException as error:
            self.failed = error
        self.ended = True
        self._reached.release()


class _SteppedObstore:
    """obstore, where a call of an actor's thread waits for its turn."""

    def __init__(self) -> None:
        self.actors: dict[threading.Thread, _Actor] = {}

    def __getattr__(self, name: str) -> Any:
        call = getattr(obstore, name)

        def stepped(*args: Any, **kwargs: Any) -> Any:
            actor = self.actors.get(threading.current_thread())
            if actor is not None and not actor._killed:
                actor.before_call()
            return call(*args, **kwargs)

        return stepped


def run_interleaved(
    works: Sequence[Callable[[], Any]],
    switches: Sequence[int],
    *,
    kill_at: int | None = None,
    monkeypatch: pytest.MonkeyPatch,
) -> int:
    """Runs both to their end, the first one first, the other one after each of the switches. A switch before
    call 0 lets the second one begin.

    Args:
        switches: numbers of calls to the store, of both together.
        kill_at: the call that kills the first one.

    Returns:
        the calls that were made.

    Raises:
        whatever one of them raised.
    """
    stepped = _SteppedObstore()
    actors = [_Actor(work) for work in works]
    stepped.actors = {actor.thread: actor for actor in actors}
    with monkeypatch.context() as patch:
        for module in (backend, store):
            patch.setattr(module, "obstore", stepped)
        for actor in actors:
            actor.start()
        turn, calls, first_calls = 0, 0, 0
        while not all(actor.ended for actor in actors):
            if calls in switches:
                turn = 1 - turn
            actor = actors[turn] if not actors[turn].ended else actors[1 - turn]
            calls += 1
            if actor is actors[0]:
                first_calls += 1
            if actor is actors[0] and kill_at is not None and first_calls > kill_at:
                actor.kill()
            else:
                actor.step()
    for actor in actors:
        if actor.failed is not None:
            raise actor.failed
    return calls


def switch_points(calls: int, *, at_most: int = 2, sampled: int = 100) -> Iterator[tuple[int, ...]]:
    """Every set of up to so many switches, and some with two more."""
    for count in range(at_most + 1):
        yield from itertools.combinations(range(calls), count)
    rng = random.Random(0)
    for _ in range(sampled):
        yield tuple(sorted(rng.sample(range(calls), min(calls, at_most + 2))))
