"""HTTP connections of one server: their number, their addresses, and the time that each may wait.

A connection has no timer of its own, because received data could reset it. Instead, a check twice a second
ends the connections that are overdue.
"""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address
from typing import Protocol

from starlette.types import Scope

from ..settings import Settings

CHECK_S = 0.5
MAX_CONNECTIONS = 4096  # even if more files may be open: each connection can use 128 KiB
# More of one address push out its idle ones. Robots behind one address have one connection each, or two.
MAX_CONNECTIONS_PER_ADDRESS = 256
HEAD_TIMEOUT_S = 20.0  # a head has at most 64 KiB: 3 kB/s
BODY_TIMEOUT_S = 30.0  # before the time for ``MIN_BYTES_PER_S``; for the next piece of an uploaded file
# Longer than the 60 s for which proxies commonly keep idle connections: a proxy closes first, so none of its
# requests meets a connection that is being closed. An idle connection costs little: it makes room for others.
KEEP_ALIVE_S = 75.0
MAX_RESERVED_FILES = 256  # open files reserved for the store, query workers, zenoh and logs
HEALTH_RESERVE = 16  # connections above the limit, for health requests only
Network = IPv4Network | IPv6Network
_IPV6_SITE_BITS = 64  # the smallest network of one subscriber: each caller has one name, not 2**64
_MAX_CHARS = 80  # of an address with the name of its network interface
UNKNOWN = "unknown"


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
        """Returns the reason to end the connection now, if there is one.

        Args:
            now: time of the event loop's clock.
        """

    def abort(self) -> None:
        """Ends the connection at once, without sending the rest."""


@dataclass(frozen=True)
class ConnectionLimits:
    """Limits of connections.

    Attributes:
        total: open connections, without the reserve for health requests.
        per_address: open connections of one address; 0: no limit.
        head_s: time for the head of a request to arrive.
        idle_s: time between two requests.
        body_s: time for a body to arrive; a long body has more time, for ``MIN_BYTES_PER_S``.
        answer_s: time for the caller to read an answer; a long answer has more, see ``ReadingPace``.
    """

    total: int = MAX_CONNECTIONS
    per_address: int = 0
    head_s: float = HEAD_TIMEOUT_S
    idle_s: float = KEEP_ALIVE_S
    body_s: float = BODY_TIMEOUT_S
    answer_s: float = 30.0

    @classmethod
    def of(cls, settings: Settings, open_files: int | None = None) -> ConnectionLimits:
        """Returns the limits of a service: as many connections as the limit of open files allows.

        Args:
            open_files: limit of this process; default: the system's.
        """
        if open_files is None:
            open_files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        total = min(_available(open_files), MAX_CONNECTIONS)
        per_address = min(MAX_CONNECTIONS_PER_ADDRESS, max(1, total // 2))
        return cls(
            total, per_address, HEAD_TIMEOUT_S, KEEP_ALIVE_S, BODY_TIMEOUT_S, settings.answer_timeout_s
        )


def _available(open_files: int) -> int:
    """Number of connections for which files can be open."""
    if open_files == resource.RLIM_INFINITY:
        return MAX_CONNECTIONS
    return max(1, open_files - min(open_files // 2, MAX_RESERVED_FILES) - HEALTH_RESERVE)


class Connections:
    """The open connections of a server. For use by one event loop.

    Args:
        trusted: networks of proxies. A connection of a proxy carries many callers, so ``per_address`` does
            not apply.
        ended: called for every connection that is ended from this side.
    """

    def __init__(
        self,
        limits: ConnectionLimits,
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
        """Finds a place for a new connection.

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
        """Removes a closed connection. A second call does nothing."""
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
        if len(self._reserve) < HEALTH_RESERVE or self._make_room(self._reserve):
            self._reserve[connection] = None
            return ConnectionUse.HEALTH_ONLY
        return ConnectionUse.NONE

    def _has_place(self, address: str | None) -> bool:
        of_address, limit = self._open.get(address, {}), self.limits.per_address
        if address is not None and 0 < limit <= len(of_address) and not self._make_room(of_address):
            return False
        return self._total < self.limits.total or self._make_room_anywhere()

    def _make_room_anywhere(self) -> bool:
        fullest = sorted(self._open, key=lambda address: (address is None, -len(self._open[address])))
        return any(self._make_room(self._open[address]) for address in fullest)

    def _make_room(self, among: dict[Connection, None]) -> bool:
        """Ends the oldest of these connections that waits for its caller. Returns False if there is none."""
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


def client_address(peer: str | None, forwarded_for: Iterable[str], trusted: Iterable[Network]) -> str:
    """Returns the address of the nearest caller that is not a trusted proxy; for IPv6 its /64 network.

    Args:
        peer: address of the connection, if known.
        forwarded_for: values of X-Forwarded-For, in order. Each proxy appends the address of its caller. So
            the values are read from the end, as long as the proxies are trusted: anybody can have written the
            rest.
    """
    networks = tuple(trusted)
    address = _parsed(peer or "")
    hops = [hop.strip() for value in forwarded_for for hop in value.split(",")]
    while address is not None and hops and _is_in(address, networks):
        hop = _parsed(hops.pop())
        if hop is None:
            break
        address = hop
    return UNKNOWN if address is None else _named(address)


def address_of(scope: Scope, trusted: Iterable[Network]) -> str:
    """Returns the address of a request's caller, see ``client_address``."""
    peer = scope["client"][0] if scope.get("client") else None
    forwarded_for = [
        value.decode("latin-1") for name, value in scope["headers"] if name == b"x-forwarded-for"
    ]
    return client_address(peer, forwarded_for, trusted)


def is_within(peer: str | None, networks: Iterable[Network]) -> bool:
    """Returns whether the address of a connection is in one of these networks."""
    address = _parsed(peer or "")
    return address is not None and _is_in(address, networks)


def _is_in(address: IPv4Address | IPv6Address, networks: Iterable[Network]) -> bool:
    return any(address in network for network in networks)


def _parsed(text: str) -> IPv4Address | IPv6Address | None:
    return _read(text) if len(text) <= _MAX_CHARS else None


@lru_cache(4096)  # callers come again, and reading an address takes longer than all else here
def _read(text: str) -> IPv4Address | IPv6Address | None:
    try:
        address = ip_address(text)
    except ValueError:
        return None
    if isinstance(address, IPv6Address):
        return address.ipv4_mapped or address
    return address


def _named(address: IPv4Address | IPv6Address) -> str:
    if isinstance(address, IPv4Address):
        return str(address)
    return str(IPv6Network((int(address), _IPV6_SITE_BITS), strict=False))
