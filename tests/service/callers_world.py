"""Several callers of one service, each with a key."""

from __future__ import annotations

import base64
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.store.store import Store
from tests.service.service_world import Service, running_service

PART = "application/offset+octet-stream"
CLOUD = b"0 0 0\n1 1 1\n"


@dataclass
class Caller:
    """A caller with its own key."""

    service: Service
    key: str

    @property
    def headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.key}"}

    def call(self, method: str, path: str, **more: Any) -> httpx.Response:
        headers = {**self.headers, **more.pop("headers", {})}
        return self.service.http.request(method, path, headers=headers, **more)

    def announce(self, size_bytes: int = 1000) -> httpx.Response:
        name = base64.b64encode(b"hall.xyz").decode()
        headers = {"Upload-Length": str(size_bytes), "Upload-Metadata": f"filename {name}"}
        return self.call("POST", "/uploads", headers=headers)

    def begin(self, size_bytes: int = 1000) -> str:
        """Begins an upload and returns its path."""
        answer = self.announce(size_bytes)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def send(self, url: str, data: bytes, offset: int = 0) -> httpx.Response:
        headers = {"Content-Type": PART, "Upload-Offset": str(offset)}
        return self.call("PATCH", url, content=data, headers=headers)

    def post_map(self, map_id: str = "hall", cloud: bytes = CLOUD, key: str | None = None) -> httpx.Response:
        headers = {} if key is None else {"Idempotency-Key": key}
        return self.call(
            "POST", "/maps", data={"map_id": map_id}, files={"source": ("a.xyz", cloud)}, headers=headers
        )

    @contextmanager
    def sending(self, url: str, size_bytes: int, sent: bytes = b"x") -> Iterator[socket.socket]:
        """A PATCH request whose body never ends."""
        address = urlsplit(self.service.url)
        head = (
            f"PATCH {url} HTTP/1.1\r\nHost: x\r\nContent-Type: {PART}\r\nUpload-Offset: 0\r\n"
            f"Authorization: Bearer {self.key}\r\nContent-Length: {size_bytes}\r\n\r\n"
        )
        with socket.create_connection((str(address.hostname), int(address.port or 0))) as connection:
            connection.sendall(head.encode() + sent)
            yield connection


@dataclass
class Callers:
    service: Service
    a: Caller
    b: Caller
    admin: Caller


@contextmanager
def callers(directory: Path, **changes: Any) -> Iterator[Callers]:
    keys = ApiKeys(Store.open(str(directory / "store")))
    made = [
        keys.create(name, Grant.parse([scope], ["*"]))[1]
        for name, scope in (("a", "build"), ("b", "build"), ("admin", "admin"))
    ]
    with running_service(directory, **{"auth": "on", "zenoh": False, **changes}) as service:
        yield Callers(service, *(Caller(service, key) for key in made))
