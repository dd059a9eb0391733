"""A running service with a real file store and loopback sockets; only its localizer is a fake."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import zenoh
from fastapi import FastAPI

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.errors import CorruptVersion
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix_service.app import create_app
from firstfix_service.server import Server
from firstfix_service.settings import Settings
from tests.servers import free_port
from tests.service.changed_constants import changed_constants
from tests.waiting import LIMIT_S, wait_until

FAKE_WORKER = (sys.executable, str(Path(__file__).with_name("fake_worker.py")))  # of builds
XYZ = "application/vnd.firstfix.xyz"
SCAN_BODY = np.arange(300, dtype="<f4").reshape(100, 3).tobytes()


@dataclass
class Behaviour:
    """Behaviour of the fake localizers, shared by all of a test."""

    raises: Exception | None = None
    gate: threading.Event | None = None  # wait for it before answering
    started: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    loads: list[str] = field(default_factory=list)
    answers: Callable[..., Localization] | None = None  # given the localizer, and what it was given

    def load(self, directory: Path) -> FakeLocalizer:
        label = (directory / "label.txt").read_text()
        self.loads.append(label)
        if label == "unreadable":
            raise CorruptVersion("label.txt: cannot be understood")
        return FakeLocalizer(float(label), self)


@dataclass
class FakeLocalizer:
    """Answers with x = its label and y = the points of the scan."""

    label: float
    behaviour: Behaviour

    def localize(self, scan: Scan, options: LocalizeOptions | None = None, *more: object) -> Localization:
        self.behaviour.started.release()
        if self.behaviour.gate is not None:
            assert self.behaviour.gate.wait(LIMIT_S)
        if self.behaviour.raises is not None:
            raise self.behaviour.raises
        if self.behaviour.answers is not None:
            return self.behaviour.answers(self, scan, options, *more)
        return self.found(scan)

    def found(self, scan: Scan) -> Localization:
        T = np.eye(4)
        T[:2, 3] = self.label, len(scan)
        return Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.9, timings_ms={"search": 1.5})


def publish(catalog: Catalog, map_id: str, label: str, scratch: Path, *, provisional: bool = False) -> str:
    """Publishes a version whose fake localizer answers x = label, and returns its digest."""
    directory = scratch / f"{map_id}-{label}"
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "label.txt").write_text(label)
    return catalog.publish(map_id, directory, Manifest.for_directory(directory, provisional=provisional))


@dataclass
class Service:
    """A running service."""

    url: str
    endpoint: str
    http: httpx.Client
    session: Any
    catalog: Catalog
    behaviour: Behaviour
    settings: Settings
    scratch: Path
    app: FastAPI
    stop: Callable[[], None]

    def value(self, metric: str, **labels: str) -> float:
        """The value of a metric; 0 where nothing was counted."""
        return self.app.state.metrics.registry.get_sample_value(metric, labels) or 0.0

    def part(self, kind: type) -> Any:
        return self.app.state.start.parts[kind]

    def wait_until_loaded(self, maps: int = 1) -> None:
        wait_until(lambda: self.http.get("/readyz").json().get("maps") == maps)

    def open_gate(self) -> None:
        assert self.behaviour.gate is not None
        self.behaviour.gate.set()

    def ask(self, transport: str, **query: Any) -> Reply:
        return {"http": self.ask_http, "zenoh": self.ask_zenoh}[transport](**query)

    def ask_http(
        self,
        body: bytes = SCAN_BODY,
        media_type: str = XYZ,
        map_id: str = "hall",
        options: dict[str, str] | None = None,
        content_encoding: str | None = None,
    ) -> Reply:
        headers = {"Content-Type": media_type}
        if content_encoding:
            headers["Content-Encoding"] = content_encoding
        response = self.http.post(
            "/localize", params={"map": map_id, **(options or {})}, content=body, headers=headers
        )
        return Reply(response.status_code == 200, response.content, response.headers["content-type"])

    def ask_zenoh(
        self,
        body: bytes = SCAN_BODY,
        media_type: str = XYZ,
        map_id: str = "hall",
        options: dict[str, str] | None = None,
        content_encoding: str | None = None,
        key: str | None = None,
    ) -> Reply:
        parameters = dict(options or {})
        if content_encoding:
            parameters["content_encoding"] = content_encoding
        selector = zenoh.Selector(key or f"firstfix/{map_id}/localize", parameters)
        replies = list(self.session.get(selector, payload=body, encoding=media_type, timeout=LIMIT_S))
        assert len(replies) == 1, "exactly one reply"
        sample = replies[0].ok or replies[0].err
        return Reply(replies[0].ok is not None, sample.payload.to_bytes(), str(sample.encoding))


@dataclass(frozen=True)
class Reply:
    ok: bool
    body: bytes
    media_type: str

    @property
    def json(self) -> dict[str, Any]:
        return dict(json.loads(self.body))

    @property
    def x(self) -> float:
        return float(self.json["T_map_sensor"]["position"][0])


@contextmanager
def running_service(directory: Path, **changes: Any) -> Iterator[Service]:
    with changed_constants({"min_free_bytes": 0, **changes}) as settings:
        yield from _running_service(directory, **settings)


@contextmanager
def served(
    directory: Path, maps: dict[str, str] | None = None, *, is_gated: bool = False, **changes: Any
) -> Iterator[Service]:
    """A running service with these maps, each with the label of its version. Default: "hall", of label 1.

    Args:
        is_gated: its localizers wait until ``open_gate``.
    """
    if is_gated:
        changes["behaviour"] = Behaviour(gate=threading.Event())
    with running_service(directory, **changes) as service:
        for map_id, label in ({"hall": "1"} if maps is None else maps).items():
            publish(service.catalog, map_id, label, service.scratch)
        yield service


def serving(**settings: Any) -> pytest.MarkDecorator:
    """Tells the fixture ``service`` (or, for all tests of a file, ``shared_service``) how to run."""
    return pytest.mark.serving(**settings)


def environment_of(folder: Path, **settings: object) -> dict[str, str]:
    """The environment of a service in a process of its own, with everything in a folder."""
    values = {
        "store": folder / "store",
        "work_dir": folder / "work",
        "cache_dir": folder / "cache",
        "run_builds": "false",
        "workers": 1,
        **settings,
    }
    return {**os.environ, **{f"FIRSTFIX_{name.upper()}": str(value) for name, value in values.items()}}


def is_ready(url: str) -> bool:
    """False, too, where nothing listens yet."""
    try:
        return httpx.get(f"{url}/readyz", timeout=LIMIT_S).is_success
    except httpx.TransportError:
        return False


def _running_service(directory: Path, **changes: Any) -> Iterator[Service]:
    behaviour = changes.pop("behaviour", None) or Behaviour()
    load = changes.pop("load", behaviour.load)
    settings = Settings(
        **{
            "store": str(directory / "store"),
            "port": 0,
            "cache_dir": directory / "cache",
            "work_dir": directory / "work",
            "poll_interval_s": 0.1,
            "run_builds": False,
            "workers": 2,
            "zenoh": True,
            "zenoh_listen": (f"tcp/127.0.0.1:{free_port()}",),
            "replica": "r1",
            **changes,
        }
    )
    endpoint = settings.zenoh_listen[0]
    app = create_app(settings, load=load)
    server = Server(app, settings)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    wait_until(lambda: server.started or not thread.is_alive())
    assert server.started, "the service did not start"
    port = server.servers[0].sockets[0].getsockname()[1]
    session = None

    def stop() -> None:
        server.should_exit = True

    try:
        if settings.zenoh_enabled:
            session = client_session(endpoint)
            token = f"firstfix/@any/localize/{settings.replica or '*'}"
            wait_until(lambda: list(session.liveliness().get(token, timeout=5)))
        url = f"http://127.0.0.1:{port}"
        with httpx.Client(base_url=url, timeout=LIMIT_S) as http:
            catalog = Catalog(Store.open(settings.store))
            made = directory / "made"
            yield Service(url, endpoint, http, session, catalog, behaviour, settings, made, app, stop)
    finally:
        if behaviour.gate is not None:
            behaviour.gate.set()
        if session is not None:
            session.close()
        stop()
        thread.join(LIMIT_S)
        assert not thread.is_alive(), "the service did not stop"


def client_session(endpoint: str) -> Any:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", str(int(LIMIT_S * 1000)))  # a service may listen for HTTP first
    config.insert_json5("connect/retry", '{"period_init_ms": 50, "period_max_ms": 1000}')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)
