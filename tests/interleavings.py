"""Two actors that use one store at once, in every order of their calls that can make a difference."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import obstore
import pytest

from firstfix.store import backend, store

WAIT_S = 60.0


class Killed(BaseException):
    """Ends an actor in the middle of its work."""


@dataclass
class Step:
    """A call of an actor to the store, with the calls that its helper threads make before its next one."""

    actor: int
    reads: set[str] = field(default_factory=set)
    lists: set[str] = field(default_factory=set)  # folders
    writes: set[str] = field(default_factory=set)

    def record(self, call: str, key: str) -> None:
        kinds = {
            "put": self.writes,
            "delete": self.writes,
            "list": self.lists,
            "list_with_delimiter": self.lists,
        }
        kinds |= dict.fromkeys(("get", "get_range", "head"), self.reads)
        kinds[call].add(key)

    def conflicts(self, other: Step) -> bool:
        """Returns whether the order of two steps can matter: one writes an object that the other touches."""
        return self._changes_what_is_seen_by(other) or other._changes_what_is_seen_by(self)

    def _changes_what_is_seen_by(self, other: Step) -> bool:
        return bool(self.writes & (other.writes | other.reads)) or any(
            key.startswith(f"{folder}/" if folder else "") for key in self.writes for folder in other.lists
        )


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
        self.steps: list[Step] = []

    def __getattr__(self, name: str) -> Any:
        call = getattr(obstore, name)

        def stepped(*args: Any, **kwargs: Any) -> Any:
            actor = self.actors.get(threading.current_thread())
            if actor is not None and not actor._killed:
                actor.before_call()
            self.steps[-1].record(name, args[1] or "")
            return call(*args, **kwargs)

        return stepped


def run_interleaved(
    works: Sequence[Callable[[], Any]],
    switches: Sequence[int],
    *,
    kill_at: int | None = None,
    monkeypatch: pytest.MonkeyPatch,
) -> list[Step]:
    """Run both actors to their end, the first one first, the other one after each of the switches.

    A switch before call 0 lets the second one begin.

    Args:
        switches: numbers of calls to the store, of both together.
        kill_at: the call that kills the first one.

    Returns:
        The steps in the order in which they were made.

    Raises:
        Exception: the first one that an actor raised.
    """
    stepped = _SteppedObstore()
    actors = [_Actor(work) for work in works]
    stepped.actors = {actor.thread: actor for actor in actors}
    with monkeypatch.context() as patch:
        for module in (backend, store):
            patch.setattr(module, "obstore", stepped)
        for actor in actors:
            actor.start()
        turn, first_calls = 0, 0
        while not all(actor.ended for actor in actors):
            if len(stepped.steps) in switches:
                turn = 1 - turn
            number = turn if not actors[turn].ended else 1 - turn
            stepped.steps.append(Step(number))
            first_calls += number == 0
            if number == 0 and kill_at is not None and first_calls > kill_at:
                actors[number].kill()
            else:
                actors[number].step()
    for actor in actors:
        if actor.failed is not None:
            raise actor.failed
    return stepped.steps


def run_every_order(run: Callable[[tuple[int, ...]], list[Step]], *, sampled: int = 30) -> int:
    """Run two actors with every set of up to two switches that can make a difference, and with some of four.

    Two orders have the same effect if they differ only in neighbouring steps without a conflict. So a switch
    back is left out in two cases: the first actor's next step has no conflict with what the second one did
    since the switch (the switch one call later does the same), or the last step of the second one has no
    conflict with what the first one does after it (the switch back one call earlier does the same).

    Args:
        run: runs both with these switches, and checks the outcome.

    Returns:
        The number of runs.
    """
    alone, runs = run(()), 1
    first = [step for step in alone if step.actor == 0]
    for begin, next_step in enumerate(first):
        second = [step for step in run((begin,)) if step.actor == 1]
        runs += 1
        after: list[Step] | None = None  # what the first one does after the switch back, in the last run
        for length in range(1, len(second)):
            if after is None:
                is_new = any(step.conflicts(next_step) for step in second[:length])
            else:
                is_new = any(step.conflicts(second[length - 1]) for step in after)
            if is_new:
                steps = run((begin, begin + length))
                runs += 1
                after = [step for step in steps[begin + length :] if step.actor == 0]
    rng = random.Random(0)
    for _ in range(sampled):
        run(tuple(sorted(rng.sample(range(len(alone)), min(len(alone), 4)))))
    return runs + sampled
