"""A broken network between a client and a server: toxiproxy, steered over its HTTP API."""

from __future__ import annotations

import uuid
from collections.abc import Iterator

import httpx
import pytest

from tests.servers import free_port, program, running
from tests.waiting import LIMIT_S


class Toxiproxy:
    """A running toxiproxy-server."""

    def __init__(self, api: str) -> None:
        self._http = httpx.Client(base_url=api, timeout=LIMIT_S)

    def link(self, upstream: str) -> Link:
        """A port that leads to ``host:port``."""
        name, port = uuid.uuid4().hex, free_port()
        wanted = {"name": name, "listen": f"127.0.0.1:{port}", "upstream": upstream, "enabled": True}
        self._http.post("/proxies", json=wanted).raise_for_status()
        return Link(self._http, name, f"127.0.0.1:{port}")

    def close(self) -> None:
        self._http.close()


class Link:
    """One way through it.

    Attributes:
        address: ``host:port`` to connect to.
    """

    def __init__(self, http: httpx.Client, name: str, address: str) -> None:
        self._http, self._name, self.address = http, name, address

    def cut(self) -> None:
        """Connections end, new ones are refused."""
        self._enable(False)

    def mend(self) -> None:
        """Removes all faults from the link."""
        for toxic in self._http.get(f"/proxies/{self._name}/toxics").json():
            self._http.delete(f"/proxies/{self._name}/toxics/{toxic['name']}").raise_for_status()
        self._enable(True)

    def poison(self, kind: str, stream: str = "downstream", **attributes: int) -> None:
        """Adds a toxic: https://github.com/Shopify/toxiproxy lists them."""
        wanted = {"type": kind, "stream": stream, "attributes": attributes}
        self._http.post(f"/proxies/{self._name}/toxics", json=wanted).raise_for_status()

    def _enable(self, enabled: bool) -> None:
        self._http.post(f"/proxies/{self._name}", json={"enabled": enabled}).raise_for_status()


@pytest.fixture(scope="session")
def toxiproxy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Toxiproxy]:
    name = program("toxiproxy-server", "make all-test-servers builds it, with Go")
    port = free_port()
    command = [name, "-host", "127.0.0.1", "-port", str(port)]
    with running(command, port, tmp_path_factory.mktemp("toxiproxy") / "log"):
        proxy = Toxiproxy(f"http://127.0.0.1:{port}")
        yield proxy
        proxy.close()
