"""Clients against a running service: the same tests over all three, and uploads over bad lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.builds.records import new_status
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import (
    BuildFailed,
    ChecksumMismatch,
    Conflict,
    DeadlineExceeded,
    FirstfixError,
    InvalidOption,
    InvalidScan,
    NoSuchFile,
    NotFound,
)
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix_client import Client, RetryPolicy, ZenohClient
from firstfix_client.steps import builds as build_steps
from tests.blocked_async_client import BlockedAsyncClient
from tests.service.service_world import Behaviour, FakeLocalizer, Service, publish, running_service, serving

KINDS = ["http", "asyncio", "zenoh"]
POINTS = np.random.default_rng(5).uniform(-20, 20, (800, 3))
SCAN = Scan.from_points(POINTS)
PARAMETERS = DescriptorParameters(descriptor=LayeredOccupancy(PolarGrid(20, 60, 25.0)))
NOWHERE = 7.0


class Told(FakeLocalizer):
    """Repeats the query in its answer, and rejects queries to the map with the label NOWHERE."""

    def localize(self, scan: Any, options: LocalizeOptions | None = None, *_: object) -> Localization:
        if self.label == NOWHERE:
            return Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))
        answer = super().localize([] if not hasattr(scan, "__len__") else scan, options)
        T = np.array(answer.T_map_sensor)
        if options is not None and options.gravity is not None:
            T[2, 3] = float(options.gravity[1])
        if options is not None and options.prior is not None:
            T[2, 3] += options.prior.radius_m
        return Localization(answer.verdict, (), T, None, np.eye(6), 0.9, timings_ms={"search": 1.5})


class Tells(Behaviour):
    def load(self, directory: Path) -> FakeLocalizer:
        return Told(super().load(directory).label, self)


@pytest.fixture(scope="module")
def told_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("service"), behaviour=Tells()) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        publish(running.catalog, "nowhere", str(NOWHERE), running.scratch)
        for kind in KINDS:
            publish(running.catalog, f"of-{kind}", "2", running.scratch)
        yield running


@pytest.fixture(scope="module")
def clients(told_service: Service) -> Iterator[dict[str, Any]]:
    with (
        Client(told_service.url) as http,
        BlockedAsyncClient(told_service.url) as asynchronous,
        ZenohClient(told_service.endpoint, url=told_service.url) as over_zenoh,
    ):
        yield {"http": http, "asyncio": asynchronous, "zenoh": over_zenoh}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def client(clients: dict[str, Any], kind: str) -> Any:
    return clients[kind]


def the_file(folder: Path) -> Path:
    path = folder / "scan.npy"
    np.save(path, POINTS)
    return path


QUERIES: dict[str, Callable[[Any, Path], Localization]] = {
    "scan": lambda c, folder: c.localize(SCAN, map_id="hall"),
    "points": lambda c, folder: c.localize(POINTS, map_id="hall"),
    "list": lambda c, folder: c.localize(POINTS[:300].tolist(), map_id="hall"),
    "file": lambda c, folder: c.localize(the_file(folder), map_id="hall"),
    "range image": lambda c, folder: c.localize(SCAN, map_id="hall", encoding="range_image"),
    "compact": lambda c, folder: c.localize(SCAN, map_id="hall", encoding="compact"),
    "descriptor": lambda c, folder: c.localize(
        SCAN, map_id="hall", encoding="descriptor", parameters=PARAMETERS
    ),
    "several scans": lambda c, folder: c.localize(
        ScanSequence((SCAN, SCAN), np.stack([np.eye(4)] * 2)), map_id="hall"
    ),
    "gravity": lambda c, folder: c.localize(SCAN, map_id="hall", gravity=[0, 0.6, -0.8]),
    "prior": lambda c, folder: c.localize(SCAN, map_id="hall", prior=Prior(np.zeros(3), 4.0)),
    "options": lambda c, folder: c.localize(
        SCAN, map_id="hall", prior=Prior(np.zeros(3), 4.0), options=LocalizeOptions(max_candidates=3)
    ),
    "not localized": lambda c, folder: c.localize(SCAN, map_id="nowhere"),
    "no such map": lambda c, folder: c.localize(SCAN, map_id="yard"),
    "no map's name": lambda c, folder: c.localize(SCAN, map_id="Über"),
    "no points": lambda c, folder: c.localize(np.zeros((4, 2)), map_id="hall"),
    "no file": lambda c, folder: c.localize(folder / "none.pcd", map_id="hall"),
    "no such version": lambda c, folder: c.localize(
        SCAN, map_id="hall", options=LocalizeOptions(version="0" * 64)
    ),
    "no such encoding": lambda c, folder: c.localize(SCAN, map_id="hall", encoding="morse"),
}


def said(ask: Callable[[Any, Path], Localization], client: Any, folder: Path) -> Any:
    """An answer without its times, or the class of an error."""
    try:
        answer = ask(client, folder).to_mapping()
    except FirstfixError as error:
        return type(error)
    return {name: value for name, value in answer.items() if name != "timings_ms"}


@pytest.mark.parametrize("query", QUERIES)
def test_all_clients_get_the_same_answers(clients: dict[str, Any], query: str, tmp_path: Path):
    answers = {kind: said(QUERIES[query], client, tmp_path) for kind, client in clients.items()}
    assert answers["asyncio"] == answers["http"]
    assert answers["zenoh"] == answers["http"]
    refused = {
        "no such map": NotFound,
        "no map's name": InvalidOption,
        "no points": InvalidScan,
        "no file": NoSuchFile,
        "no such version": NotFound,
        "no such encoding": InvalidOption,
    }
    if query in refused:
        assert answers["http"] is refused[query]
    elif query == "not localized":
        assert (answers["http"]["verdict"], answers["http"]["T_map_sensor"]) == ("rejected", None)
    else:
        x, y, z = answers["http"]["T_map_sensor"]["position"]
        assert x == 1
        assert z == {"gravity": 0.6, "prior": 4.0, "options": 4.0}.get(query, 0)
        if query in ("scan", "points", "file"):
            assert y == len(POINTS)


def test_an_answer_is_frozen(client: Any):
    answer = client.localize(SCAN, map_id="hall")
    for field in fields(answer):
        with pytest.raises(AttributeError):
            setattr(answer, field.name, None)


def test_the_maps_are_listed(client: Any, told_service: Service):
    maps = {info.map_id: info.active_version for info in client.maps()}
    assert set(maps) == {"hall", "nowhere", *(f"of-{kind}" for kind in KINDS)}
    assert maps["hall"] == told_service.catalog.active_version("hall")


def test_versions_are_activated_rolled_back_and_retired(client: Any, kind: str, told_service: Service):
    map_id = f"of-{kind}"
    first = told_service.catalog.active_version(map_id)
    second = publish(told_service.catalog, map_id, "3", told_service.scratch)
    assert [info.version for info in client.versions(map_id)] == [second, first]
    assert client.show_map(map_id).active_version == second
    client.activate(map_id, first)
    assert [info.active for info in client.versions(map_id)] == [False, True]
    assert client.roll_back(map_id) == second
    client.retire(map_id, first)
    with pytest.raises(Conflict):
        client.retire(map_id, second)
    with pytest.raises(NotFound):
        client.activate(map_id, "0" * 64)
    with pytest.raises(NotFound):
        client.versions("yard")
    assert client.collect_garbage(map_id, dry_run=True)["dry_run"] is True


def test_a_georeference_is_set_and_deleted(client: Any, kind: str):
    map_id = f"of-{kind}"
    client.set_georeference(map_id, latitude_deg=48, longitude_deg=11, height_m=500, x_axis_deg=90)
    assert client.georeference(map_id)["x_axis_deg"] == pytest.approx(90)
    client.delete_georeference(map_id)
    with pytest.raises(NotFound):
        client.georeference(map_id)


def test_a_build_is_submitted_and_followed(client: Any, kind: str, told_service: Service, tmp_path: Path):
    map_id = f"of-{kind}"
    source = tmp_path / "map.xyz"
    source.write_bytes(b"0 0 0\n")
    status = client.build_map(source, map_id, config={"level": False})
    assert (status.state, status.map_id) == ("queued", map_id)
    assert [one.build_id for one in client.builds(map_id=map_id)] == [status.build_id]
    with pytest.raises(DeadlineExceeded):
        list(client.build_events(status.build_id, timeout_s=0.3))
    events = []
    for one in client.build_events(status.build_id):
        events.append(one.state)
        after = "running" if one.state == "queued" else "failed"
        told_service.catalog.builds.set_status(status.build_id, new_status(after, map_id=map_id))
    assert events == ["queued", "running", "failed"]
    with pytest.raises(BuildFailed):
        client.wait_for_build(status.build_id)
    assert [one.build_id for one in client.builds(map_id=map_id, state="queued")] == []
    with pytest.raises(NotFound):
        next(client.build_events("none"))
    with pytest.raises(Conflict):
        client.cancel_build(status.build_id)


def test_a_build_is_waited_for(client: Any, kind: str, told_service: Service, tmp_path: Path):
    source = tmp_path / "map.xyz"
    source.write_bytes(b"1 1 1\n")
    seen = []

    def progress(status: Any) -> None:
        seen.append(status.state)
        after = new_status("succeeded", map_id=f"of-{kind}", version="ff" * 32)
        told_service.catalog.builds.set_status(status.build_id, after)

    status = client.build_map(source, f"of-{kind}", progress=progress)
    assert (status.version, status.is_final) == ("ff" * 32, True)
    assert seen == ["queued", "succeeded"]


def test_a_zenoh_client_without_a_url_cannot_manage_maps(told_service: Service):
    with ZenohClient(told_service.endpoint) as client:
        assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
        with pytest.raises(InvalidOption, match="url"):
            client.versions("hall")
        with pytest.raises(InvalidOption, match="url"):
            client.builds()


over_http = serving(zenoh=False)

DATA = bytes(range(256)) * 200
QUICK = RetryPolicy(attempts=6, first_wait_s=0.01, max_wait_s=0.05)


class Breaks(httpx.HTTPTransport):
    """A network that loses requests or answers, as the test says."""

    def __init__(self, loses: Callable[[int, httpx.Request], str | None]) -> None:
        super().__init__()
        self.loses, self.count, self.sent = loses, 0, 0

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        self.count += 1
        what = self.loses(self.count, request)
        if what == "request":
            raise httpx.ConnectError("lost")
        if request.method == "PATCH":
            self.sent += int(request.headers["content-length"])
        response = super().handle_request(request)
        if what == "answer":
            response.close()
            raise httpx.ReadError("lost")
        return response


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_steps, "PART_BYTES", 5000)
    monkeypatch.setattr(build_steps, "IN_PARTS_FROM_BYTES", 10_000)


def file_of(tmp_path: Path, data: bytes = DATA) -> Path:
    path = tmp_path / "hall.xyz"
    path.write_bytes(data)
    return path


@pytest.mark.usefixtures("small_parts")
@over_http
def test_a_large_file_goes_in_parts_over_a_bad_line(service: Service, tmp_path: Path):
    network = Breaks(lambda n, request: {0: "request", 1: "answer"}.get(n % 4))
    with Client(service.url, retry=QUICK, transport=network) as client:
        status = client.build_map(file_of(tmp_path), "hall", config={"level": False})
    request = service.catalog.builds.request(status.build_id)
    assert service.catalog.store.get(request["source"]["key"]) == DATA
    assert request["file_name"] == "hall.xyz"
    assert request["config"] == {"level": False}
    assert len(service.catalog.builds.ids()) == 1
    assert network.sent < 2 * len(DATA), "no part that arrived is sent again more than once"


@pytest.mark.usefixtures("small_parts")
@over_http
def test_uploads_are_removed_after_the_build_is_submitted(service: Service, tmp_path: Path):
    with Client(service.url, retry=QUICK) as client:
        client.build_map(file_of(tmp_path), "hall", trajectory=file_of(tmp_path))
    assert service.catalog.store.list("uploads") == []


@pytest.mark.usefixtures("small_parts")
@over_http
def test_a_file_that_changes_while_it_is_read_is_refused(service, tmp_path, monkeypatch):
    monkeypatch.setattr(build_steps, "_sha256", lambda path: "0" * 64)
    with Client(service.url, retry=QUICK) as client, pytest.raises(ChecksumMismatch):
        client.build_map(file_of(tmp_path), "hall")
    assert service.catalog.builds.ids() == []


@over_http
def test_a_small_file_sent_again_is_one_build(service: Service, tmp_path: Path):
    network = Breaks(lambda n, request: "answer" if n <= 3 else None)
    with Client(service.url, retry=QUICK, transport=network) as client:
        client.build_map(file_of(tmp_path), "hall")
    assert len(service.catalog.builds.ids()) == 1


@over_http
def test_all_pages_of_a_list_are_read(service: Service, monkeypatch: pytest.MonkeyPatch):
    for n in range(4):
        publish(service.catalog, f"m{n}", "1", service.scratch)
        publish(service.catalog, "hall", str(n + 2), service.scratch)

    class TwoAPage(httpx.HTTPTransport):
        def handle_request(self, request: httpx.Request) -> httpx.Response:
            request.url = request.url.copy_set_param("limit", "2")
            return super().handle_request(request)

    with Client(service.url, transport=TwoAPage()) as client:
        assert [info.map_id for info in client.maps()] == ["hall", "m0", "m1", "m2", "m3"]
        assert len(client.versions("hall")) == 5
