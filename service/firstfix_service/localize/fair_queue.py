"""Whose turn it is: a queue for every map, and the maps in a ring."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

SLOW_S = 0.25  # mean time of a map's queries, over which it never gets the last worker
RECENT_S = 60.0  # a map that was asked so long ago may be asked again any moment
_WEIGHT = 0.1  # of the newest query in a mean time
_MAX_IDLE_GROUPS = 1000


class State(Enum):
    PREPARING = "preparing"
    READY = "ready"
    RUNNING = "running"
    GONE = "gone"  # ended, refused, or nobody waits for it


@dataclass(eq=False)
class Job:
    """One query in the pool.

    Attributes:
        held: what was prepared for it.
        ready_since: of ``time.monotonic``; since then it waits for its turn.
        seconds: that its work took.
    """

    group: str
    work: Callable[[Any, float], Any]
    result: asyncio.Future[Any]
    deadline: float | None
    state: State = State.PREPARING
    held: Any = None
    ready_since: float = 0.0
    seconds: float = 0.0
    timer: asyncio.TimerHandle | None = None


@dataclass
class _Group:
    """A map's queries; dicts as ordered sets.

    Attributes:
        waiting: preparing or ready, by arrival.
        mean_s: of the work of those that ended lately.
        asked: when the last one came.
    """

    waiting: dict[Job, None] = field(default_factory=dict)
    ready: dict[Job, None] = field(default_factory=dict)
    running: int = 0
    mean_s: float = 0.0
    asked: float = 0.0

    @property
    def idle(self) -> bool:
        return not self.waiting and not self.running


class FairQueue:
    """One event loop's, but for ``size`` and ``crowding``."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._groups: OrderedDict[str, _Group] = OrderedDict()  # a ring: who had a turn goes to the end
        self._running = 0
        self.size = 0  # waiting and running
        self.mean_s = 1.0  # of all queries' work

    def add(self, job: Job) -> None:
        group = self._groups.setdefault(job.group, _Group())
        group.waiting[job] = None
        group.asked = time.monotonic()
        self.size += 1

    def make_ready(self, job: Job) -> None:
        job.state, job.ready_since = State.READY, time.monotonic()
        self._groups[job.group].ready[job] = None

    def remove(self, job: Job) -> None:
        """One that waits."""
        group = self._groups[job.group]
        del group.waiting[job]
        group.ready.pop(job, None)
        job.state = State.GONE
        self.size -= 1
        self._tidy(job.group)

    def next(self) -> Job | None:
        """The one to begin now, which then counts as running; None while there is no worker for any."""
        if self._running >= self._workers:
            return None
        for name, group in self._groups.items():
            if group.ready and group.running < self._most_at_once(group):
                self._groups.move_to_end(name)
                job = next(iter(group.ready))
                del group.ready[job], group.waiting[job]
                job.state = State.RUNNING
                group.running += 1
                self._running += 1
                return job
        return None

    def ended(self, job: Job) -> None:
        group = self._groups[job.group]
        job.state = State.GONE
        group.running -= 1
        self._running -= 1
        self.size -= 1
        group.mean_s = _mean(group.mean_s or job.seconds, job.seconds)
        self.mean_s = _mean(self.mean_s, job.seconds)
        self._tidy(job.group)

    def waiting(self) -> list[Job]:
        return [job for group in self._groups.values() for job in group.waiting]

    def crowding(self, group: str | None) -> Job | None:
        """The newest job of the group with most that wait, if this one has fewer, itself included."""
        groups = list(self._groups.items())
        if not groups:
            return None
        longest = max((g for _, g in groups), key=lambda g: len(g.waiting))
        own = 0 if group is None else next((len(g.waiting) for name, g in groups if name == group), 0)
        if len(longest.waiting) <= own + 1:
            return None
        return next(reversed(longest.waiting), None)

    def _most_at_once(self, group: _Group) -> int:
        """A map whose queries take long leaves a worker to the others, if there are others."""
        if self._workers == 1 or group.mean_s <= SLOW_S:
            return self._workers
        since = time.monotonic() - RECENT_S
        others = any(g is not group and (not g.idle or g.asked > since) for g in self._groups.values())
        return self._workers - 1 if others else self._workers

    def _tidy(self, name: str) -> None:
        """Forgets a map that nothing ran for, as somebody may have made it up, and of many the oldest."""
        group = self._groups[name]
        if group.idle and not group.mean_s:
            del self._groups[name]
        if len(self._groups) > _MAX_IDLE_GROUPS:
            for other in [key for key, g in self._groups.items() if g.idle][: _MAX_IDLE_GROUPS // 2]:
                del self._groups[other]


def _mean(old: float, new: float) -> float:
    return old + _WEIGHT * (new - old)
