"""The HTTP connections of one server: how many there may be, and how long each may wait for its caller.

No connection has a timer of its own that received data could reset. One look, twice a second, goes over all
of them and ends those that are overdue.
"""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import structlog

from ..settings import Settings
from .client_address import Network, client_address, is_within

_log = structlog.get_logger(__name__)
LOOK_S = 0.5
MOST_CONNECTIONS = 4096  # by default, however many files may be open: each can hold 128 KiB
MOST_RESERVED_FILES = 256  # of the limit of open files: for the store, workers, zenoh, logs
HEALTH_RESERVE = 16  # connections beyond the limit, which may ask for the health alone


class Admission(Enum):
    """Whether a new connection may stay."""

    FULL = "full"
    HEALTH_ONLY = "health_only"  # all places, or its address's, are taken by callers that are being served
    REFUSED = "refused"


class Ended(Enum):
    """Reasons to end a connection from this side; the label of a metric."""

    HEAD = "head"  # no request came, or it did not arrive as a whole
    BODY = "body"  # the body came too slowly
    IDLE = "idle"  # no further request came
    ANSWER = "answer"  # the caller did not take in its answer
    UNREAD = "unread"  # the caller went on sending a body that nobody reads
    ROOM = "room"  # it waited for its caller, and another one needed the place
    REFUSED = "refused"  # there was no place for it


class Connection(Protocol):
    """An HTTP connection as this module needs it."""

    @property
    def peer(self) -> str | None: ...

    @property
    def waits_for_caller(self) -> bool:
        """Nothing is being done for the caller: to end the connection loses no work."""

    def overdue(self, now: float) -> Ended | None:
        """The reason to end it now; None if there is none.

        Args:
            now: of the event loop's clock.
        """

    def abort(self) -> None:
        """Ends it at once; what was not sent is lost."""


@dataclass(frozen=True)
class ConnectionLimits:
    """
    Attributes:
        total: connections at the same time, without the reserve for the health.
        per_address: of one address; 0: any number.
        head_s: for the head of a request to arrive.
        idle_s: between two requests.
        body_s: for a body to arrive; a longer one has ``MIN_BYTES_PER_S`` besides.
        answer_s: for an answer to be taken in; the same.
    """

    total: int = MOST_CONNECTIONS
    per_address: int = 0
    head_s: float = 20.0
    idle_s: float = 30.0
    body_s: float = 30.0
    answer_s: float = 30.0

    @classmethod
    def of(cls, settings: Settings, open_files: int | None = None) -> ConnectionLimits:
        """
        Args:
            open_files: the limit of this process; default: as the system says.
        """
        room = _room(resource.getrlimit(resource.RLIMIT_NOFILE)[0] if open_files is None else open_files)
        total = settings.max_connections or min(room, MOST_CONNECTIONS)
        if total > room:
            _log.warning("too few files may be open for so many connections", wanted=total, possible=room)
            total = room
        per_address = settings.max_connections_per_address
        return cls(
            total,
            min(per_address, max(1, total // 2)),
            settings.head_timeout_s,
            settings.keep_alive_s,
            settings.body_timeout_s,
            settings.answer_timeout_s,
        )


def _room(open_files: int) -> int:
    if open_files == resource.RLIM_INFINITY:
        return MOST_CONNECTIONS
    return max(1, open_files - min(open_files // 2, MOST_RESERVED_FILES) - HEALTH_RESERVE)


class Connections:
    """For one event loop.

    Args:
        trusted: networks of proxies: one connection of theirs carries many callers, so they have no limit
            of their own.
        ended: told of every connection that is ended from this side.
    """

    def __init__(
        self,
        limits: ConnectionLimits,
        trusted: Iterable[Network] = (),
        ended: Callable[[Ended], None] = lambda why: None,
    ) -> None:
        self.limits = limits
        self._trusted = tuple(trusted)
        self._ended = ended
        # Oldest first, by address; those of trusted proxies by None.
        self._open: dict[str | None, dict[Connection, None]] = {}
        self._reserve: dict[Connection, None] = {}
        self._total = 0
        self._look: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return self._total + len(self._reserve)

    def admit(self, connection: Connection) -> Admission:
        """Finds a place for a new connection. Where there is none, one that waits for its caller has to go:
        of the same address if that one has too many, else of the address that has most."""
        admission = self._place(connection)
        if admission is Admission.REFUSED:
            self._ended(Ended.REFUSED)
        elif self._look is None:
            self._look = asyncio.get_running_loop().call_later(LOOK_S, self._end_overdue)
        return admission

    def leave(self, connection: Connection) -> None:
        """The connection is closed. Once more does nothing."""
        if connection in self._reserve:
            del self._reserve[connection]
            return
        address = self._address(connection)
        of_address = self._open.get(address, {})
        if connection in of_address:
            del of_address[connection]
            self._total -= 1
            if not of_address:
                del self._open[address]

    def _place(self, connection: Connection) -> Admission:
        address = self._address(connection)
        if self._has_place(address):
            self._open.setdefault(address, {})[connection] = None
            self._total += 1
            return Admission.FULL
        if len(self._reserve) < HEALTH_RESERVE or self._make_room(self._reserve):
            self._reserve[connection] = None
            return Admission.HEALTH_ONLY
        return Admission.REFUSED

    def _has_place(self, address: str | None) -> bool:
        of_address, most = self._open.get(address, {}), self.limits.per_address
        if address is not None and 0 < most <= len(of_address) and not self._make_room(of_address):
            return False
        return self._total < self.limits.total or self._make_room_anywhere()

    def _make_room_anywhere(self) -> bool:
        fullest = sorted(self._open, key=lambda address: (address is None, -len(self._open[address])))
        return any(self._make_room(self._open[address]) for address in fullest)

    def _make_room(self, among: dict[Connection, None]) -> bool:
        """Ends the oldest of these that waits for its caller. False: none does."""
        oldest = next((one for one in among if one.waits_for_caller), None)
        if oldest is None:
            return False
        self._end(oldest, Ended.ROOM)
        return True

    def _end_overdue(self) -> None:
        loop = asyncio.get_running_loop()
        now = loop.time()
        connections = [one for of_address in self._open.values() for one in of_address] + list(self._reserve)
        for connection in connections:
            if (why := connection.overdue(now)) is not None:
                self._end(connection, why)
        self._look = loop.call_later(LOOK_S, self._end_overdue) if len(self) else None

    def _end(self, connection: Connection, why: Ended) -> None:
        self.leave(connection)
        self._ended(why)
        connection.abort()

    def _address(self, connection: Connection) -> str | None:
        if is_within(connection.peer, self._trusted):
            return None
        return client_address(connection.peer, (), ())
