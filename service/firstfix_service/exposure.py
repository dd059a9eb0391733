"""Whether strangers can reach this service, and that nobody opens it to them by mistake."""

from __future__ import annotations

import ipaddress
import re

import structlog

from firstfix.errors import InvalidOption

from .settings import Settings

_log = structlog.get_logger(__name__)
_ZENOH_HOST = re.compile(r"\[?([^\]/]*?)\]?(:\d+)?")
_LOCAL_PROTOCOLS = {"unixsock-stream", "unixpipe"}


def check_exposure(settings: Settings) -> None:
    """Says in the log who is let in.

    Raises:
        InvalidOption: it can be reached from beyond this machine, and nobody has said whether callers are
            to be told apart there.
    """
    exposed = exposed_at(settings)
    if settings.auth is None and exposed:
        raise InvalidOption(
            f"{exposed} can be reached from beyond this machine: set FIRSTFIX_AUTH=on, and give out keys by "
            "'firstfix keys create'; or FIRSTFIX_AUTH=off, where a network or a proxy keeps strangers out"
        )
    if settings.auth == "on":
        _log.info("callers need a key or a token", tokens=settings.jwt_jwks is not None)
        if settings.zenoh_enabled and settings.zenoh_trusted:
            _log.warning("zenoh callers need no key: zenoh's own access rules have to keep others out")
    elif settings.jwt_jwks is not None:
        raise InvalidOption("FIRSTFIX_JWT_JWKS is of no use without FIRSTFIX_AUTH=on")
    else:
        _log.warning("authentication is off: whoever reaches this service may do everything", at=exposed)


def exposed_at(settings: Settings) -> str:
    """Addresses by which others than this machine reach the service; empty: none.

    An operator's zenoh configuration file is not looked into: what it opens, its own TLS, users and access
    rules are there to guard.
    """
    found = [] if is_loopback(settings.host) else [f"HTTP on {settings.host}"]
    if settings.zenoh_enabled and settings.zenoh_config is None:
        endpoints = (*settings.zenoh_listen, *settings.zenoh_connect)
        found += [f"zenoh by {endpoint}" for endpoint in endpoints if not _is_local_endpoint(endpoint)]
    return ", ".join(found)


def is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _is_local_endpoint(endpoint: str) -> bool:
    """Of ``protocol/address?metadata#config``: whether it stays within this machine."""
    protocol, _, rest = endpoint.partition("/")
    if protocol in _LOCAL_PROTOCOLS:
        return True
    address = re.split(r"[?#]", rest)[0]
    match = _ZENOH_HOST.fullmatch(address)
    return match is not None and is_loopback(match[1])
