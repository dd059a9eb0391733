"""A fair queue: every map has a queue of its own, and the maps take turns."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable, Coroutine
from contextvars import Context
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

SLOW_S = 0.25  # a map whose queries take longer on average never gets the last worker
RECENT_S = 60.0  # a map that was queried within this time may be queried again at any moment
_WEIGHT = 0.1  # of the newest query in a moving average
_MAX_IDLE_GROUPS = 1000


class State(Enum):
    """State of a query in the pool."""

    PREPARING = "preparing"
    READY = "ready"
    RUNNING = "running"
    GONE = "gone"  # ended, refused, or abandoned by its caller


@dataclass(eq=False)
class Job:
    """One query in the pool.

    Attributes:
        prepared: result of its preparation; None while it is being prepared.
        context: of the request, for its work.
        ready_since: ``time.monotonic`` when it was prepared and began to wait for its turn.
        began: ``time.monotonic`` when its work began.
    """

    group: str
    work: Callable[[Any, float], Coroutine[Any, Any, Any]]
    result: asyncio.Future[Any]
    deadline: float | None
    context: Context
    state: State = State.PREPARING
    prepared: Any = None
    ready_since: float = 0.0
    began: float = 0.0
    timer: asyncio.TimerHandle | None = None


@dataclass
class _Group:
    """The queries of one map. Dicts serve as ordered sets.

    Attributes:
        waiting: preparing or ready, by arrival.
        mean_s: moving average of the duration of their work.
        asked: ``time.monotonic`` when the last one came.
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
    """Queries that wait or run. Belongs to one event loop; ``size`` may be read by any thread."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        # A ring: a group that had its turn goes to the end.
        self._groups: OrderedDict[str, _Group] = OrderedDict()
        self._running = 0
        self.size = 0  # waiting and running
        self.mean_s = 1.0  # moving average over all queries

    def add(self, job: Job) -> None:
        """Adds a query that is being prepared."""
        group = self._groups.setdefault(job.group, _Group())
        group.waiting[job] = None
        group.asked = time.monotonic()
        self.size += 1

    def make_ready(self, job: Job) -> None:
        """Lets a prepared query wait for its turn."""
        job.state, job.ready_since = State.READY, time.monotonic()
        self._groups[job.group].ready[job] = None

    def remove(self, job: Job) -> None:
        """Removes a query that waits."""
        group = self._groups[job.group]
        del group.waiting[job]
        group.ready.pop(job, None)
        job.state = State.GONE
        self.size -= 1
        self._tidy(job.group)

    def next(self) -> Job | None:
        """Returns the query to run now, which then counts as running; None if no query can run."""
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

    def ended(self, job: Job, seconds: float) -> None:
        """Removes a query whose work has ended, after so many seconds."""
        group = self._groups[job.group]
        job.state = State.GONE
        group.running -= 1
        self._running -= 1
        self.size -= 1
        group.mean_s = _mean(group.mean_s or seconds, seconds)
        self.mean_s = _mean(self.mean_s, seconds)
        self._tidy(job.group)

    def waiting(self) -> list[Job]:
        """Returns all queries that wait."""
        return [job for group in self._groups.values() for job in group.waiting]

    def crowding(self, group: str) -> Job | None:
        """Returns the newest query of the longest group; None if this group with one more is as long."""
        if not self._groups:
            return None
        longest = max(self._groups.values(), key=lambda one: len(one.waiting))
        own = self._groups.get(group)
        if len(longest.waiting) <= (0 if own is None else len(own.waiting)) + 1:
            return None
        return next(reversed(longest.waiting), None)

    def _most_at_once(self, group: _Group) -> int:
        """Workers for one group at a time: a slow map leaves one to the other maps, if there are any."""
        if self._workers == 1 or group.mean_s <= SLOW_S:
            return self._workers
        since = time.monotonic() - RECENT_S
        others = any(g is not group and (not g.idle or g.asked > since) for g in self._groups.values())
        return self._workers - 1 if others else self._workers

    def _tidy(self, name: str) -> None:
        """Forgets a map without any answer, as its id may be invented; and the oldest of too many maps."""
        group = self._groups[name]
        if group.idle and not group.mean_s:
            del self._groups[name]
        if len(self._groups) > _MAX_IDLE_GROUPS:
            for other in [key for key, g in self._groups.items() if g.idle][: _MAX_IDLE_GROUPS // 2]:
                del self._groups[other]


def _mean(old: float, new: float) -> float:
    return old + _WEIGHT * (new - old)
