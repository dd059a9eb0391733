"""The calls of the drill, over HTTP and zenoh: each returns "ok" or the code of its error."""

from __future__ import annotations

import itertools
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import zenoh

from firstfix.builds.records import FINAL_STATES
from tests.tiny_worker import config_telling

from .load import Kind
from .part import BY_ROUTER
from .yard import MAP, Yard

TIMEOUT_S = 60.0
QUERIES_OPEN = 4  # of a kind: with those of the zenoh peer they fit into the service's queue
_UPLOAD = b"0 0 0\n" * 10_000


class Calls:
    """Callers of one service.

    Args:
        url: of the service.
        endpoint: at which the service listens for zenoh.
        router: endpoint of a zenoh router.

    Attributes:
        versions: of the map, that answer alike.
    """

    def __init__(self, url: str, endpoint: str, router: str, yard: Yard) -> None:
        self._yard = yard
        self._http = {name: _client(url, address) for name, address in _ADDRESSES.items()}
        self._zenoh = {"zenoh": endpoint, BY_ROUTER: router}
        self._sessions: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._seeds = itertools.count()
        self._submitted: list[str] = []
        self.versions = yard.versions
        self._next_version = itertools.cycle(yard.versions)

    def kinds(self) -> list[Kind]:
        """The load: some 13 calls a second."""
        return [
            Kind("localize a", 4.0, lambda: self.localize("localize a"), QUERIES_OPEN),
            Kind("localize b", 4.0, lambda: self.localize("localize b"), QUERIES_OPEN),
            Kind("zenoh", 2.0, lambda: self.ask_zenoh("zenoh"), QUERIES_OPEN),
            Kind(BY_ROUTER, 1.0, lambda: self.ask_zenoh(BY_ROUTER), QUERIES_OPEN),
            Kind("metrics", 1.0, lambda: _code(self._http["others"], "GET", "/metrics")),
            Kind("maps", 1.0, lambda: _code(self._http["others"], "GET", "/maps")),
            Kind("activate", 0.5, lambda: self.activate(next(self._next_version))),
            Kind("upload", 0.5, self.upload),
            Kind("build", 0.1, self.build),
        ]

    def close(self) -> None:
        for session in self._sessions.values():
            session.close()
        for http in self._http.values():
            http.close()

    def localize(self, caller: str) -> str:
        query = self._yard.query
        headers = {"Content-Type": query.media_type}
        path = f"/localize?map={MAP}"
        return _code(self._http[caller], "POST", path, content=query.content, headers=headers)

    def ask_zenoh(self, by: str) -> str:
        query = self._yard.query
        key = f"firstfix/{MAP}/localize"
        try:
            replies = self._session(by).get(
                key,
                payload=query.content,
                encoding=query.media_type,
                timeout=TIMEOUT_S,
                consolidation=zenoh.ConsolidationMode.NONE,  # as robots ask: the first reply is the answer
            )
            reply = next(iter(replies), None)
        except zenoh.ZError:
            return "connection"
        if reply is None:
            return "no reply"
        if reply.ok is not None:
            return "ok"
        try:
            return str(json.loads(reply.err.payload.to_bytes())["code"])
        except (ValueError, KeyError):
            return "no reply"  # zenoh's own: the time is over

    def activate(self, version: str) -> str:
        return _code(self._http["others"], "POST", f"/maps/{MAP}/versions/{version}/activate")

    def upload(self) -> str:
        http = self._http["others"]
        headers = {"Upload-Length": str(len(_UPLOAD)), "Upload-Metadata": "filename YS54eXo="}
        begun = _answer(http, "POST", "/uploads", headers=headers)
        if isinstance(begun, str):
            return begun
        place = begun.headers["location"]
        headers = {"Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
        sent = _code(http, "PATCH", place, headers=headers, content=_UPLOAD)
        return sent if sent != "ok" else _code(http, "DELETE", place)

    def build(self) -> str:
        submitted = self.submit()
        return "ok" if submitted.startswith("/builds/") else submitted

    def submit(self) -> str:
        """Submit a build; returns its address, or the code of the error."""
        seed = next(self._seeds)
        answer = _answer(
            self._http["others"],
            "POST",
            "/maps",
            data={"map_id": "built", "config": json.dumps(config_telling(seed=seed))},
            files={"source": ("a.xyz", b"0 0 0\n" * 1000 + str(seed).encode())},
        )
        if isinstance(answer, str):
            return answer
        self._submitted.append(str(answer.headers["location"]))
        return self._submitted[-1]

    def unfinished_builds(self) -> list[str]:
        """Addresses of the submitted builds that wait or run."""
        self._submitted = [one for one in self._submitted if self.build_state(one) not in FINAL_STATES]
        return list(self._submitted)

    def build_state(self, address: str) -> str:
        answer = _answer(self._http["others"], "GET", address)
        return answer if isinstance(answer, str) else str(answer.json()["state"])

    def answering_version(self) -> str:
        """The version that answers a query now; or the code of the error."""
        query = self._yard.query
        headers = {"Content-Type": query.media_type}
        answer = _answer(
            self._http["others"], "POST", f"/localize?map={MAP}", content=query.content, headers=headers
        )
        return answer if isinstance(answer, str) else str(answer.json()["map_version"])

    def _session(self, by: str) -> Any:
        with self._lock:
            if by not in self._sessions:
                config = {
                    "mode": "client",
                    "connect": {"endpoints": [self._zenoh[by]]},
                    "scouting": {"multicast": {"enabled": False}},
                }
                self._sessions[by] = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
            return self._sessions[by]


# Each is another caller to the service, which knows callers without a key by their address.
_ADDRESSES = {"localize a": "127.0.0.2", "localize b": "127.0.0.3", "others": "127.0.0.4"}


@contextmanager
def calls_to(url: str, endpoint: str, router: str, yard: Yard) -> Iterator[Calls]:
    calls = Calls(url, endpoint, router, yard)
    try:
        yield calls
    finally:
        calls.close()


def _client(url: str, address: str) -> httpx.Client:
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=20)
    transport = httpx.HTTPTransport(local_address=address, limits=limits)
    return httpx.Client(base_url=url, timeout=TIMEOUT_S, transport=transport)


def _answer(http: httpx.Client, method: str, path: str, **more: Any) -> httpx.Response | str:
    """The answer, or the code of the error."""
    try:
        answer = http.request(method, path, **more)
    except httpx.TimeoutException:
        return "timeout"
    except httpx.TransportError:
        return "connection"
    if answer.is_success:
        return answer
    try:
        return str(answer.json()["code"])
    except (ValueError, KeyError):
        return f"status {answer.status_code}"


def _code(http: httpx.Client, method: str, path: str, **more: Any) -> str:
    answer = _answer(http, method, path, **more)
    return answer if isinstance(answer, str) else "ok"
