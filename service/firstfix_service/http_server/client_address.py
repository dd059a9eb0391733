"""Where a request comes from, through proxies that are trusted to say so and no others."""

from __future__ import annotations

from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address

Network = IPv4Network | IPv6Network
_IPV6_SITE_BITS = 64  # what one subscriber has at the least: fewer bits would give everybody many names
UNKNOWN = "unknown"


def client_address(peer: str | None, forwarded_for: Iterable[str], trusted: Iterable[Network]) -> str:
    """The address of the nearest caller that is no trusted proxy, of IPv6 its /64.

    Args:
        peer: of the connection; None: it has none.
        forwarded_for: the values of X-Forwarded-For in their order. Each proxy appends whom it heard, so
            they are read from the end, and no further than the proxies are trusted: the rest anybody can
            have written.
    """
    networks = tuple(trusted)
    address = _parsed(peer or "")
    hops = [hop.strip() for value in forwarded_for for hop in value.split(",")]
    while address is not None and hops and _is_in(address, networks):
        said = _parsed(hops.pop())
        if said is None:
            break
        address = said
    return UNKNOWN if address is None else _named(address)


def is_within(peer: str | None, networks: Iterable[Network]) -> bool:
    """Whether the address of a connection is one of these networks'."""
    address = _parsed(peer or "")
    return address is not None and _is_in(address, networks)


def _is_in(address: IPv4Address | IPv6Address, networks: Iterable[Network]) -> bool:
    return any(address in network for network in networks)


def _parsed(text: str) -> IPv4Address | IPv6Address | None:
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
