"""HTTP connections of one server: their number, and the time that each may wait.

A connection has no timer of its own, because received data could reset it. Instead, a check twice a second
ends the connections that are overdue.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Protocol

from .addresses import Network, client_address, is_within
from .limits import Limits

CHECK_S = 0.5


class ConnectionUse(Enum):
    """Requests that a new connection may make."""

    ALL = "all"
    HEALTH_ONLY = "health_only"  # all connections, or all of its address, are busy with requests
    NONE = "none"


class EndReason(Enum):
    """Reason to end a connection from this side; the label of a metric."""

    HEAD = "head"  # no complete request head arrived in time
    BODY = "body"  # the body arrived too slowly
    IDLE = "idle"  # no further request arrived
    ANSWER = "answer"  # the caller did not read its answer
    UNREAD = "unread"  # the caller went on sending a body after its answer
    ROOM = "room"  # it waited for its caller, and a new connection needed its place
    REFUSED = "refused"  # there was no place for it


class Connection(Protocol):
    """An HTTP connection, as ``Connections`` uses it."""

    @property
    def peer(self) -> str | None:
        """Address of the other end, if known."""

    @property
    def waits_for_caller(self) -> bool:
        """True if no work is done for the caller now, so that no work is lost if the connection ends."""

    def overdue(self, now: float) -> EndReason | None:
        """The reason to end the connection now, if there is one.

        Args:
            now: time of the event loop's clock.
        """

    def abort(self) -> None:
        """End the connection at once, without sending the rest."""


class Connections:
    """The open connections of a server. For use by one event loop.

    Args:
        trusted: networks of proxies. A connection of a proxy carries many callers, so the limit of an
            address does not apply.
        ended: called for every connection that is ended from this side.
    """

    def __init__(
        self,
        limits: Limits,
        trusted: Iterable[Network] = (),
        ended: Callable[[EndReason], None] = lambda why: None,
    ) -> None:
        self.limits = limits
        self._trusted = tuple(trusted)
        self._ended = ended
        # By address, oldest first; the key None is for trusted proxies.
        self._open: dict[str | None, dict[Connection, None]] = {}
        self._reserve: dict[Connection, None] = {}
        self._total = 0
        self._check: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return self._total + len(self._reserve)

    def admit(self, connection: Connection) -> ConnectionUse:
        """Find a place for a new connection.

        If there is no place, a connection that waits for its caller is ended: one of the same address if that
        has too many connections, otherwise one of the address with the most connections.
        """
        use = self._place(connection)
        if use is ConnectionUse.NONE:
            self._ended(EndReason.REFUSED)
        elif self._check is None:
            self._check = asyncio.get_running_loop().call_later(CHECK_S, self._end_overdue)
        return use

    def leave(self, connection: Connection) -> None:
        """Remove a closed connection. A second call does nothing."""
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

    def _place(self, connection: Connection) -> ConnectionUse:
        address = self._address(connection)
        if self._has_place(address):
            self._open.setdefault(address, {})[connection] = None
            self._total += 1
            return ConnectionUse.ALL
        if len(self._reserve) < self.limits.health_connections or self._make_room(self._reserve):
            self._reserve[connection] = None
            return ConnectionUse.HEALTH_ONLY
        return ConnectionUse.NONE

    def _has_place(self, address: str | None) -> bool:
        of_address, limit = self._open.get(address, {}), self.limits.max_connections_per_address
        if address is not None and 0 < limit <= len(of_address) and not self._make_room(of_address):
            return False
        return self._total < self.limits.max_connections or self._make_room_anywhere()

    def _make_room_anywhere(self) -> bool:
        fullest = sorted(self._open, key=lambda address: (address is None, -len(self._open[address])))
        return any(self._make_room(self._open[address]) for address in fullest)

    def _make_room(self, among: dict[Connection, None]) -> bool:
        """End the oldest of these connections that waits for its caller. Returns False if there is none."""
        oldest = next((one for one in among if one.waits_for_caller), None)
        if oldest is None:
            return False
        self._end(oldest, EndReason.ROOM)
        return True

    def _end_overdue(self) -> None:
        loop = asyncio.get_running_loop()
        now = loop.time()
        connections = [one for of_address in self._open.values() for one in of_address] + list(self._reserve)
        for connection in connections:
            if (why := connection.overdue(now)) is not None:
                self._end(connection, why)
        self._check = loop.call_later(CHECK_S, self._end_overdue) if len(self) else None

    def _end(self, connection: Connection, why: EndReason) -> None:
        self.leave(connection)
        self._ended(why)
        connection.abort()

    def _address(self, connection: Connection) -> str | None:
        if is_within(connection.peer, self._trusted):
            return None
        return client_address(connection.peer, (), ())
