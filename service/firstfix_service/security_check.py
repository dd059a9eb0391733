"""Check that a service that other machines can reach is not left open by mistake."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import structlog

from firstfix.errors import InvalidOption
from firstfix.wire.endpoints import Links, is_local_endpoint, is_loopback, said_by_zenoh

from .settings import Settings

_log = structlog.get_logger(__name__)
_WAYS_OUT = (
    "Choose one of three: FIRSTFIX_AUTH=on without FIRSTFIX_ZENOH_TRUSTED, which takes zenoh queries "
    "signed with an API key alone; a FIRSTFIX_ZENOH_CONFIG whose endpoints are all tls or quic, and that has "
    "access rules or logs in to a router that has them; or FIRSTFIX_AUTH=off if a network keeps strangers out"
)


def check_security(settings: Settings) -> None:
    """Check the settings of authentication, and logs who may use the service.

    Raises:
        InvalidOption: strangers can reach the service, and the settings do not say how they are kept out.
    """
    exposed, zenoh = exposed_at(settings), open_zenoh(settings)
    if settings.auth is None and exposed:
        raise InvalidOption(
            f"{exposed} can be reached from other machines: set FIRSTFIX_AUTH=on and create keys with "
            "'firstfix keys create', or set FIRSTFIX_AUTH=off if a network or a proxy keeps strangers out"
            + (f". {_WAYS_OUT}" if zenoh else "")
        )
    if settings.auth == "on":
        if settings.zenoh_trusted and zenoh:
            raise InvalidOption(f"FIRSTFIX_ZENOH_TRUSTED, but strangers can reach {zenoh}. {_WAYS_OUT}")
        _log.info("callers need a key or a token", tokens=settings.jwt_jwks is not None)
        if zenoh:
            _log.info("zenoh queries need a signature with an API key", at=zenoh)
        if settings.zenoh_enabled and settings.zenoh_trusted:
            _log.warning("zenoh callers need no key: the access rules of zenoh must keep strangers out")
    elif settings.jwt_jwks is not None:
        raise InvalidOption("FIRSTFIX_JWT_JWKS has no effect without FIRSTFIX_AUTH=on")
    else:
        _log.warning("authentication is off: every caller may do everything", at=exposed)


def exposed_at(settings: Settings) -> str:
    """The addresses at which strangers can reach the service; empty if there are none."""
    http = "" if is_loopback(settings.host) else f"HTTP on {settings.host}"
    return ", ".join(filter(None, (http, open_zenoh(settings))))


def open_zenoh(settings: Settings) -> str:
    """The zenoh endpoints at which strangers may have a part in the network; empty if there are none.

    Strangers have none in a session whose endpoints are all on this machine, nor in one of the operator's
    configuration file that has TLS and access rules.

    Raises:
        InvalidOption: the configuration file cannot be read.
    """
    if not settings.zenoh_enabled:
        return ""
    if settings.zenoh_config is None:
        found = [one for one in settings.zenoh_listen + settings.zenoh_connect if not is_local_endpoint(one)]
    else:
        config = _operators_config(settings.zenoh_config)
        links = Links.of(config)
        found = [] if links.are_encrypted and _has_rules(config, links) else links.beyond
    return ", ".join(f"zenoh by {endpoint}" for endpoint in found)


def _operators_config(path: Path) -> Any:
    import zenoh  # only here, because a service without it need not load it

    try:
        return zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        raise InvalidOption(f"zenoh config: {said_by_zenoh(error)}") from None


def _has_rules(config: Any, links: Links) -> bool:
    """Whether there are access rules, or a login at routers, whose own rules are not seen here."""
    rules, users, tls = (
        json.loads(config.get_json(name)) or {}
        for name in ("access_control", "transport/auth/usrpwd", "transport/link/tls")
    )
    if rules.get("enabled") and rules.get("rules"):
        return True
    return not links.listens and bool(users.get("user") or tls.get("connect_certificate"))
