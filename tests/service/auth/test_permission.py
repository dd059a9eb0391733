"""Keys and tokens that expire or are revoked during a request."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path

import httpx
import pytest
from jwt import api_jwt

from firstfix.access.api_keys import ApiKeys
from firstfix_service.auth import key_ring
from firstfix_service.auth.authenticate import Permission
from firstfix_service.http_api.bodies import request_body
from tests.service.access_world import LaterClock, give, localize
from tests.service.service_world import XYZ, Service, publish, running_service
from tests.service.token_world import ALL_KEYS, AUDIENCE, ISSUER, signed
from tests.waiting import LIMIT_S, wait_until

BUILD = "b1"


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Service]:
    keys = tmp_path / "keys.json"
    keys.write_text(json.dumps(ALL_KEYS))
    tokens = {"jwt_jwks": str(keys), "jwt_issuer": ISSUER, "jwt_audience": AUDIENCE, "jwt_leeway_s": 0.0}
    with running_service(tmp_path, zenoh=False, auth="on", keys_refresh_s=0.1, **tokens) as running:
        running.catalog.builds.put(BUILD, {"map_id": "hall"})
        yield running


def is_known(service: Service, credential: str) -> bool:
    headers = {"Authorization": f"Bearer {credential}"}
    return service.http.get(f"/builds/{BUILD}", headers=headers).is_success


def revoke(service: Service, key: str) -> None:
    ApiKeys(service.catalog.store).revoke(key.split("_")[1])


def seen_of_events(service: Service, credential: str, opened: Callable[[], object]) -> list[str]:
    """Reads the lines of an event stream until it ends.

    Args:
        opened: called once the stream is open.
    """
    wait_until(lambda: is_known(service, credential))
    headers = {"Authorization": f"Bearer {credential}"}
    with httpx.stream(
        "GET", f"{service.url}/builds/{BUILD}/events", headers=headers, timeout=LIMIT_S
    ) as response:
        lines = response.iter_lines()
        first = next(lines)
        opened()
        return [first, *lines]


def test_an_event_stream_ends_with_its_revoked_key(guarded: Service):
    key = give(guarded, "build")
    seen = seen_of_events(guarded, key, lambda: revoke(guarded, key))
    assert seen[0] == "event: progress"
    assert "event: end" not in seen, "the build goes on"


def test_an_event_stream_ends_with_its_expired_key(guarded: Service, monkeypatch: pytest.MonkeyPatch):
    key = give(guarded, "build", expires=datetime.now(timezone.utc) + timedelta(hours=1))
    seen = seen_of_events(guarded, key, lambda: monkeypatch.setattr(key_ring, "datetime", LaterClock))
    assert "event: end" not in seen


def test_an_event_stream_ends_with_its_expired_token(guarded: Service, monkeypatch: pytest.MonkeyPatch):
    token = signed(scope="build", exp=time.time() + 3600)
    seen = seen_of_events(guarded, token, lambda: monkeypatch.setattr(api_jwt, "datetime", LaterClock))
    assert "event: end" not in seen


def test_an_event_stream_with_a_key_for_its_map_goes_on(guarded: Service, monkeypatch: pytest.MonkeyPatch):
    checks, check = [], Permission.check

    async def counted(*arguments: object) -> None:
        await check(*arguments)
        checks.append(arguments)

    monkeypatch.setattr(Permission, "check", counted)
    key = give(guarded, "build", maps=("hall",))
    wait_until(lambda: is_known(guarded, key))
    headers = {"Authorization": f"Bearer {key}"}
    with httpx.stream(
        "GET", f"{guarded.url}/builds/{BUILD}/events", headers=headers, timeout=LIMIT_S
    ) as response:
        lines = response.iter_lines()
        assert next(lines) == "event: progress"
        wait_until(lambda: len(checks) >= 2)
        guarded.catalog.store.delete(f"builds/{BUILD}/request.json")
        assert "event: end" not in list(lines)


@pytest.mark.parametrize("kind", ["a form", "a part of an upload"])
def test_an_upload_ends_with_its_revoked_key(guarded: Service, kind: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(request_body, "CHECK_S", 0.0)
    key = give(guarded, "build")
    wait_until(lambda: is_known(guarded, key))
    headers = {"Authorization": f"Bearer {key}"}

    def pieces() -> Iterator[bytes]:
        if kind == "a form":
            yield b'--B\r\nContent-Disposition: form-data; name="source"; filename="a.ply"\r\n\r\n'
        yield b"x"
        revoke(guarded, key)
        wait_until(lambda: not is_known(guarded, key))
        yield b"x"  # the next piece that arrives is refused
        yield b"x"

    if kind == "a form":
        about = {"Content-Type": "multipart/form-data; boundary=B"}
        answer = guarded.http.post("/maps", content=pieces(), headers={**headers, **about})
    else:
        announced = {"Upload-Length": "1000000", "Upload-Metadata": "filename aGFsbC5wbHk="}
        where = guarded.http.post("/uploads", headers={**headers, **announced}).headers["location"]
        about = {"Content-Type": "application/offset+octet-stream", "Upload-Offset": "0"}
        answer = guarded.http.patch(where, content=pieces(), headers={**headers, **about})
    assert (answer.status_code, answer.json()["code"]) == (401, "unauthorized")


def test_a_long_query_ends_with_its_revoked_key(guarded: Service):
    """The server receives its body past the middleware that looks after the other bodies."""
    publish(guarded.catalog, "hall", "1", guarded.scratch)
    key = give(guarded, "localize", "build")
    wait_until(lambda: is_known(guarded, key) and localize(guarded, key).is_success)
    head = [
        "POST /localize?map=hall HTTP/1.1",
        f"Host: x\r\nContent-Type: {XYZ}\r\nContent-Length: 1200000",
        f"Authorization: Bearer {key}\r\n\r\n",
    ]
    with socket.create_connection(("127.0.0.1", int(guarded.url.rpartition(":")[2])), LIMIT_S) as connection:
        connection.sendall("\r\n".join(head).encode() + bytes(100_000))
        wait_until(
            lambda: "firstfix_body_bytes 100000.0" in guarded.app.state.metrics.exposition()[0].decode()
        )
        revoke(guarded, key)
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 401")
