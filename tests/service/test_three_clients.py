"""The same tests over Client, AsyncClient and ZenohClient, against a running service."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.builds.records import new_status
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import BuildFailed, Conflict, FirstfixError, InvalidOption, InvalidScan, NotFound
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix_client import Client, ZenohClient
from tests.blocked_async_client import BlockedAsyncClient
from tests.service.service_world import Behaviour, FakeLocalizer, Service, publish, running_service

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
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("service"), behaviour=Tells()) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        publish(running.catalog, "nowhere", str(NOWHERE), running.scratch)
        for kind in KINDS:
            publish(running.catalog, f"of-{kind}", "2", running.scratch)
        yield running


@pytest.fixture(scope="module")
def clients(service: Service) -> Iterator[dict[str, Any]]:
    with (
        Client(service.url) as http,
        BlockedAsyncClient(service.url) as asynchronous,
        ZenohClient(service.endpoint, url=service.url) as over_zenoh,
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
def test_the_answers_agree(clients: dict[str, Any], query: str, tmp_path: Path):
    answers = {kind: said(QUERIES[query], client, tmp_path) for kind, client in clients.items()}
    assert answers["asyncio"] == answers["http"]
    assert answers["zenoh"] == answers["http"]
    refused = {
        "no such map": NotFound,
        "no map's name": InvalidOption,
        "no points": InvalidScan,
        "no file": NotFound,
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


def test_maps(client: Any, service: Service):
    maps = {info.map_id: info.active_version for info in client.maps()}
    assert set(maps) == {"hall", "nowhere", *(f"of-{kind}" for kind in KINDS)}
    assert maps["hall"] == service.catalog.active_version("hall")


def test_versions_go_forward_and_back(client: Any, kind: str, service: Service):
    map_id = f"of-{kind}"
    first = service.catalog.active_version(map_id)
    second = publish(service.catalog, map_id, "3", service.scratch)
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


def test_georeferences(client: Any, kind: str):
    map_id = f"of-{kind}"
    client.set_georeference(map_id, latitude_deg=48, longitude_deg=11, height_m=500, x_axis_deg=90)
    assert client.georeference(map_id)["x_axis_deg"] == pytest.approx(90)
    client.delete_georeference(map_id)
    with pytest.raises(NotFound):
        client.georeference(map_id)


def test_a_build_is_handed_in_and_followed(client: Any, kind: str, service: Service, tmp_path: Path):
    map_id = f"of-{kind}"
    source = tmp_path / "map.xyz"
    source.write_bytes(b"0 0 0\n")
    status = client.build_map(source, map_id, config={"level": False})
    assert (status.state, status.map_id) == ("queued", map_id)
    assert [one.build_id for one in client.builds(map_id=map_id)] == [status.build_id]
    events = []
    for one in client.build_events(status.build_id):
        events.append(one.state)
        after = "running" if one.state == "queued" else "failed"
        service.catalog.builds.set_status(status.build_id, new_status(after, map_id=map_id))
    assert events == ["queued", "running", "failed"]
    with pytest.raises(BuildFailed):
        client.wait_for_build(status.build_id)
    with pytest.raises(Conflict):
        client.cancel_build(status.build_id)


def test_a_build_is_waited_for(client: Any, kind: str, service: Service, tmp_path: Path):
    source = tmp_path / "map.xyz"
    source.write_bytes(b"1 1 1\n")
    seen = []

    def progress(status: Any) -> None:
        seen.append(status.state)
        after = new_status("succeeded", map_id=f"of-{kind}", version="ff" * 32)
        service.catalog.builds.set_status(status.build_id, after)

    status = client.build_map(source, f"of-{kind}", progress=progress)
    assert (status.version, status.is_final) == ("ff" * 32, True)
    assert seen == ["queued", "succeeded"]


def test_without_a_url_zenoh_says_what_it_cannot(service: Service):
    with ZenohClient(service.endpoint) as client:
        assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
        with pytest.raises(InvalidOption, match="url"):
            client.versions("hall")
        with pytest.raises(InvalidOption, match="url"):
            client.builds()
