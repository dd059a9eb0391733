"""Callers with and without a key, over both transports."""

from __future__ import annotations

from datetime import datetime, timedelta, tzinfo
from typing import Any

import httpx
import zenoh

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.doors import absent
from firstfix.errors import Unauthorized
from firstfix_service.auth.authenticate import Authenticator
from tests.service.service_world import SCAN_BODY, XYZ, Reply, Service
from tests.waiting import LIMIT_S, wait_until

HEADERS = {"Content-Type": XYZ}
# Public routes of the console, and those that name a package that is left out.
CONSOLE = {"/", "/console", "/console/{path:path}"} | {
    path for package in absent() for path in package.routes
}
API_PAGE = {"/docs", "/docs/{name}", "/redoc", "/swagger"}
KEYED: dict[str, Any] = {
    "auth": "on",
    "keys_refresh_s": 0.1,
}  # a service that asks for keys, and hears of new ones


class LaterClock(datetime):
    """A clock that is a day ahead."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:
        return datetime.now(tz) + timedelta(days=1)


class Clock:
    """A clock that stands until it is set."""

    def __init__(self, now: float = 0.0) -> None:
        self.now = now

    def advance(self, seconds: float) -> None:
        self.now += seconds

    def __call__(self) -> float:
        return self.now


def give(service: Service, *scopes: str, maps: tuple[str, ...] = ("*",), **more: Any) -> str:
    return ApiKeys(service.catalog.store).create("test", Grant.parse(scopes, maps), **more)[1]


def known(service: Service, *scopes: str, **more: Any) -> str:
    """A new key which the service has read: what shows this counts for another key."""
    key = give(service, *scopes, **more)
    wait_until(lambda: _is_known(service, key))
    return key


def _is_known(service: Service, key: str) -> bool:
    ring = service.app.state.start.parts[Authenticator].keys
    try:
        return bool(ring.principal(key))
    except Unauthorized:
        return False


def bearer(key: str | None) -> dict[str, str]:
    return {} if key is None else {"Authorization": f"Bearer {key}"}


def localize(service: Service, key: str | None, query: str = "?map=hall") -> httpx.Response:
    return service.http.post(f"/localize{query}", content=SCAN_BODY, headers={**HEADERS, **bearer(key)})


def get(service: Service, path: str, key: str | None) -> httpx.Response:
    return service.http.get(path, headers=bearer(key))


def ask_zenoh(service: Service, key: str | None, map_id: str = "hall") -> Reply:
    selector = zenoh.Selector(f"firstfix/{map_id}/localize", {})
    (reply,) = service.session.get(selector, payload=SCAN_BODY, encoding=XYZ, attachment=key, timeout=LIMIT_S)
    sample = reply.ok or reply.err
    return Reply(reply.ok is not None, sample.payload.to_bytes(), str(sample.encoding))
