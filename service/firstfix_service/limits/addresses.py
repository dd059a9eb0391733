"""Addresses of callers, behind proxies that are trusted."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address

from starlette.types import Scope

Network = IPv4Network | IPv6Network
_IPV6_SITE_BITS = 64  # the smallest network of one subscriber: each caller has one name, not 2**64
_MAX_CHARS = 80  # of an address with the name of its network interface
UNKNOWN = "unknown"


def client_address(peer: str | None, forwarded_for: Iterable[str], trusted: Iterable[Network]) -> str:
    """The address of the nearest caller that is not a trusted proxy; for IPv6 its /64 network.

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
    """The address of a request's caller, see ``client_address``."""
    client = scope.get("client")
    peer = client[0] if client else None
    if not trusted:
        return _of_peer(peer)
    forwarded_for = [
        value.decode("latin-1") for name, value in scope["headers"] if name == b"x-forwarded-for"
    ]
    return client_address(peer, forwarded_for, trusted)


def is_within(peer: str | None, networks: Iterable[Network]) -> bool:
    """Whether the address of a connection is in one of these networks."""
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


@lru_cache(4096)
def _of_peer(peer: str | None) -> str:
    return client_address(peer, (), ())


@lru_cache(4096)
def _named(address: IPv4Address | IPv6Address) -> str:
    if isinstance(address, IPv4Address):
        return str(address)
    return str(IPv6Network((int(address), _IPV6_SITE_BITS), strict=False))
