"""A fair queue: callers take turns by the workers' time that they use, and so do the maps of each caller.

Virtual time is that of start-time fair queueing (Goyal, Vin and Cheng, 1996): a turn costs what it takes, and
who has used the least time goes next. Who begins to ask is not behind the others, and not before them either.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from contextvars import Context
from dataclasses import dataclass, field
from enum import Enum
from operator import attrgetter
from typing import Any

from .asker import Asker
from .slow_share import SlowShare

_NEWEST_WEIGHT = 0.1  # in the moving averages
_PLACES = attrgetter("places")
MAX_IDLE = 4000  # maps of callers without a query in the gate, whose usual queries are remembered


class State(Enum):
    """State of a query in the gate."""

    PREPARING = "preparing"
    READY = "ready"
    RUNNING = "running"
    GONE = "gone"  # ended, refused, or abandoned by its caller


@dataclass(eq=False)
class Job:
    """One query in the gate.

    Attributes:
        size_bytes: of its body, from which its time is estimated.
        ask_for, failed: see ``QueryGate.run``.
        context: of the request, for its work.
        prepared: result of its preparation; None while it is being prepared.
        ready_since: time when it was prepared and began to wait for its turn.
        began: time when its work began.
        charged_s: time that its turn was charged when its work began.
        is_slow: whether it counted as slow then.
        worker, answer: that it was given, and what comes of it; None while it has none.
        shares: of its caller and of its map, from when it is added.
    """

    asker: Asker
    ask_for: Callable[[Any, float], Any]
    result: asyncio.Future[Any]
    deadline: float
    size_bytes: int
    context: Context
    state: State = State.PREPARING
    prepared: Any = None
    ready_since: float = 0.0
    began: float = 0.0
    charged_s: float = 0.0
    is_slow: bool = False
    timer: asyncio.TimerHandle | None = None
    worker: Any = None
    answer: asyncio.Future[Any] | None = None
    failed: Callable[[Any, Exception], Awaitable[None]] | None = None
    shares: tuple[_Caller, _Map] = field(init=False)


@dataclass
class UsualQuery:
    """The usual query of a caller in a map: moving averages over those that ended."""

    seconds: float
    size_bytes: float

    def include(self, seconds: float, size_bytes: int) -> None:
        """Include one more."""
        self.seconds += _NEWEST_WEIGHT * (seconds - self.seconds)
        self.size_bytes += _NEWEST_WEIGHT * (size_bytes - self.size_bytes)

    def expected_s(self, size_bytes: int) -> float:
        """The time that a query will take: as usual, and longer in proportion if it is larger."""
        return self.seconds * max(1.0, size_bytes / max(1.0, self.size_bytes))


@dataclass
class _Share:
    """One of those who take turns.

    Attributes:
        places: number of queries in the gate.
        used_s: the workers' time that it has used, counted from the time of those that it takes turns with.
    """

    places: int = 0
    used_s: float = 0.0


@dataclass
class _Map(_Share):
    """The queries of one caller in one map. Dicts serve as ordered sets.

    Attributes:
        waiting: preparing or ready, by arrival.
        has_run: whether a query of it was given to a worker, so that its map exists.
        usual: None: no query has ended yet, or only cancelled ones.
    """

    has_run: bool = False
    waiting: dict[Job, None] = field(default_factory=dict)
    ready: dict[Job, None] = field(default_factory=dict)
    usual: UsualQuery | None = None

    @property
    def ready_since(self) -> float:
        return next(iter(self.ready)).ready_since


@dataclass
class _Caller(_Share):
    """The queries of one caller.

    Attributes:
        ready: its maps with queries that can run.
        virtual_time_s: of its maps: the used time of the one that had the last turn.
    """

    maps: dict[str, _Map] = field(default_factory=dict)
    ready: dict[str, _Map] = field(default_factory=dict)
    virtual_time_s: float = 0.0

    @property
    def ready_since(self) -> float:
        return min(one.ready_since for one in self.ready.values())


class FairQueue:
    """Queries that wait or run. Belongs to one event loop; ``size`` may be read by any thread.

    Args:
        clock: monotonic time in seconds.
    """

    def __init__(self, workers: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._workers = workers
        self._clock = clock
        self._callers: dict[str, _Caller] = {}
        self._present: dict[str, _Caller] = {}  # those with a query: few of all that are remembered
        self._idle: OrderedDict[Asker, None] = OrderedDict()  # without a query, the longest idle first
        self._slow = SlowShare(workers, clock)
        self._running = 0
        self._virtual_time_s = 0.0  # the used time of the caller that had the last turn
        self.usual: UsualQuery | None = None  # of all callers
        self.size = 0  # waiting and running
        self.ready = 0  # that wait for their turn

    @property
    def mean_s(self) -> float:
        """Moving average of the time of a query, of all callers."""
        return 1.0 if self.usual is None else self.usual.seconds

    def add(self, job: Job) -> None:
        """Add a query that is being prepared."""
        asker = job.asker
        caller = self._callers.get(asker.caller)
        if caller is None:
            caller = self._callers[asker.caller] = _Caller()
        of_map = caller.maps.get(asker.map_id)
        if of_map is None:
            of_map = caller.maps[asker.map_id] = _Map()
        job.shares = caller, of_map
        of_map.waiting[job] = None
        caller.places += 1
        self._present[asker.caller] = caller
        of_map.places += 1
        self._idle.pop(asker, None)
        self._slow.entered(asker)
        self.size += 1

    def make_ready(self, job: Job) -> None:
        """Let a prepared query wait for its turn."""
        caller, of_map = job.shares
        job.state, job.ready_since = State.READY, self._clock()
        of_map.ready[job] = None
        caller.ready[job.asker.map_id] = of_map
        caller.used_s = max(caller.used_s, self._virtual_time_s)
        of_map.used_s = max(of_map.used_s, caller.virtual_time_s)
        self.ready += 1

    def remove(self, job: Job) -> None:
        """Remove a query that waits."""
        if job.state is State.READY:
            self._take(job)
        else:
            del job.shares[1].waiting[job]
        self._leave(job)

    def next(self) -> Job | None:
        """The query to run now, which then counts as running; None if no query can run."""
        if not self.ready or self._running >= self._workers:
            return None
        callers = [one for one in self._present.values() if one.ready]
        if len(callers) > 1:
            callers.sort(key=_turn)
        for caller in callers:
            maps = list(caller.ready.values())
            if len(maps) > 1:
                maps.sort(key=_turn)
            for of_map in maps:
                job = next(iter(of_map.ready))
                usual = of_map.usual or self.usual
                job.charged_s = 0.0 if usual is None else usual.expected_s(job.size_bytes)
                job.is_slow = self._slow.is_slow(job.charged_s)
                if job.is_slow and not self._slow.may_begin(job.asker):
                    continue
                # The virtual time is that of who has the turn, and all who wait come up to it. Who may not
                # use its turn now does not save it up.
                self._virtual_time_s, caller.virtual_time_s = caller.used_s, of_map.used_s
                for waiting in callers:
                    waiting.used_s = max(waiting.used_s, caller.used_s)
                for beside in maps:
                    beside.used_s = max(beside.used_s, of_map.used_s)
                self._begin(job, caller, of_map)
                return job
        return None

    def ended(self, job: Job, seconds: float, *, is_whole: bool = True) -> None:
        """Remove a query whose work has ended, after so many seconds.

        Args:
            is_whole: False: it was cancelled, and would have taken longer. It tells of a usual query only if
                it took longer than that: who lets slow queries be cancelled is slow, too.
        """
        caller, of_map = job.shares
        size_bytes = job.size_bytes
        self._running -= 1
        self._slow.runs(job.asker, -job.is_slow)
        caller.used_s = max(caller.used_s + seconds - job.charged_s, self._virtual_time_s)
        of_map.used_s = max(of_map.used_s + seconds - job.charged_s, caller.virtual_time_s)
        known = of_map.usual or self.usual
        if is_whole or (known is not None and seconds > known.seconds):
            for one in (of_map, self):
                if one.usual is None:
                    one.usual = UsualQuery(seconds, size_bytes)
                else:
                    one.usual.include(seconds, size_bytes)
        self._leave(job)

    def waiting(self) -> list[Job]:
        """All queries that wait."""
        maps = [of_map for caller in self._present.values() for of_map in caller.maps.values()]
        return [job for of_map in maps for job in of_map.waiting]

    def crowding(self, asker: Asker) -> Job | None:
        """The query that makes room for another one; None if who asks has as many as anybody.

        It is the newest of the caller with most queries. If the one who asks is that caller, it is the newest
        of its map with most.
        """
        own = self._callers.get(asker.caller, _Caller())
        waiting = (one for one in self._present.values() if _fullest(one) is not None)
        most = max(waiting, key=_PLACES, default=own)
        if most.places > own.places + 1:
            return _newest(most)
        own_map, fullest = own.maps.get(asker.map_id, _Map()), _fullest(own)
        if fullest is None or fullest.places <= own_map.places + 1:
            return None
        return next(reversed(fullest.waiting))

    def _begin(self, job: Job, caller: _Caller, of_map: _Map) -> None:
        self._take(job)
        job.state, of_map.has_run = State.RUNNING, True
        caller.used_s += job.charged_s
        of_map.used_s += job.charged_s
        self._running += 1
        self._slow.runs(job.asker, job.is_slow)

    def _take(self, job: Job) -> None:
        """Take a query out of those that can run."""
        caller, of_map = job.shares
        del of_map.waiting[job], of_map.ready[job]
        if not of_map.ready:
            del caller.ready[job.asker.map_id]
        self.ready -= 1

    def _leave(self, job: Job) -> None:
        """Give back the place of a query."""
        caller, of_map = job.shares
        job.state = State.GONE
        caller.places -= 1
        of_map.places -= 1
        self.size -= 1
        self._slow.left(job.asker)
        if not caller.places:
            del self._present[job.asker.caller]
        if of_map.places:
            return
        if not of_map.has_run:  # its id may be invented
            self._forget(job.asker)
            return
        self._idle[job.asker] = None
        if len(self._idle) > MAX_IDLE:
            self._forget(self._idle.popitem(last=False)[0])

    def _forget(self, asker: Asker) -> None:
        caller = self._callers[asker.caller]
        del caller.maps[asker.map_id]
        if not caller.maps:
            del self._callers[asker.caller]


def _turn(one: _Caller | _Map) -> tuple[float, float]:
    """The order of those who are ready: by the time that they have used, and by how long they wait."""
    return one.used_s, one.ready_since


def _fullest(caller: _Caller) -> _Map | None:
    """The caller's map with most queries, of those with a waiting one."""
    return max((one for one in caller.maps.values() if one.waiting), key=_PLACES, default=None)


def _newest(caller: _Caller) -> Job:
    """The newest waiting query of the caller's map with most queries."""
    fullest = _fullest(caller)
    assert fullest is not None
    return next(reversed(fullest.waiting))
