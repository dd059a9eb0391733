"""Check that a service that other machines can reach is not left open by mistake."""

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
    """Checks the settings of authentication, and logs who may use the service.

    Raises:
        InvalidOption: other machines can reach the service, and FIRSTFIX_AUTH is not set.
    """
    exposed = exposed_at(settings)
    if settings.auth is None and exposed:
        raise InvalidOption(
            f"{exposed} can be reached from other machines: set FIRSTFIX_AUTH=on and create keys with "
            "'firstfix keys create', or set FIRSTFIX_AUTH=off if a network or a proxy keeps strangers out"
        )
    if settings.auth == "on":
        _log.info("callers need a key or a token", tokens=settings.jwt_jwks is not None)
        if settings.zenoh_enabled and settings.zenoh_trusted:
            _log.warning("zenoh callers need no key: the access rules of zenoh must keep strangers out")
    elif settings.jwt_jwks is not None:
        raise InvalidOption("FIRSTFIX_JWT_JWKS has no effect without FIRSTFIX_AUTH=on")
    else:
        _log.warning("authentication is off: every caller may do everything", at=exposed)


def exposed_at(settings: Settings) -> str:
    """Returns the addresses at which other machines can reach the service; empty if there are none.

    A zenoh configuration file of the operator is not read: its TLS, users and access rules protect what it
    opens.
    """
    found = [] if is_loopback(settings.host) else [f"HTTP on {settings.host}"]
    if settings.zenoh_enabled and settings.zenoh_config is None:
        endpoints = (*settings.zenoh_listen, *settings.zenoh_connect)
        found += [f"zenoh by {endpoint}" for endpoint in endpoints if not _is_local_endpoint(endpoint)]
    return ", ".join(found)


def is_loopback(host: str) -> bool:
    """Returns whether only this machine can reach the address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _is_local_endpoint(endpoint: str) -> bool:
    """Returns whether an endpoint ``protocol/address?metadata#config`` is on this machine only."""
    protocol, _, rest = endpoint.partition("/")
    if protocol in _LOCAL_PROTOCOLS:
        return True
    address = re.split(r"[?#]", rest)[0]
    match = _ZENOH_HOST.fullmatch(address)
    return match is not None and is_loopback(match[1])
