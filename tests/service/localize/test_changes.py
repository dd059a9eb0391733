"""GET /maps/{id}/changes: counted by replicas beside their queries, kept in one store."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.sightings.changes import changes_of
from firstfix.catalog.sightings.record import SightingsRecord
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix_cli.changes import lines_of
from firstfix_service.http_api import encoded_changes
from firstfix_service.http_api.parts import MapParts
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.query_workers.sightings.counter import MAX_WAITING, SightingCounter
from tests.changed_hall import Hall, pose, standing
from tests.commands import firstfix
from tests.service.access_world import KEYED, get, known
from tests.service.service_world import Service, publish, running_service
from tests.waiting import wait_until

SIZE_M = (16.2, 10.2, 4.2)
RACK = (9.2, 4.2, 0.0, 10.3, 6.3, 2.3)
MAPPED, NOW = Hall(SIZE_M, standing(RACK)), Hall(SIZE_M, standing())
SPOTS = [(4.1, 5.2), (5.3, 3.4), (6.2, 7.1), (13.1, 5.2), (12.4, 3.3), (7.6, 2.5), (12.2, 7.6), (3.2, 8.1)]
SPOTS += [(13.4, 4.1), (12.7, 6.4), (11.9, 2.2)]  # more where only some tests ask


class KnowsItsPlace(Localizer):
    """Finds a scan at the spot whose number is the number of points over a thousand."""

    probability = 0.999

    def localize(self, scan: Any, options: LocalizeOptions | None = None, *_: object) -> Localization:
        T = pose(*SPOTS[len(scan) % 1000])
        return Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), self.probability)


def body(spot: int) -> bytes:
    scan: Scan = NOW.scan(NOW.simulator(), pose(*SPOTS[spot]), np.random.default_rng(spot))
    return scan.points[: len(scan) // 1000 * 1000 - 1000 + spot].tobytes()


BODIES = [body(spot) for spot in range(len(SPOTS))]


def load(directory: Path) -> Localizer:
    return KnowsItsPlace(MAPPED.index)


@pytest.fixture
def replicas(tmp_path: Path) -> Iterator[Callable[..., Service]]:
    """Starts services over one store, which has a map."""
    with ExitStack() as stack:

        def start(name: str, **changes: Any) -> Service:
            given = {"store": str(tmp_path / "store"), "load": load, "zenoh": False, "replica": name}
            service = stack.enter_context(running_service(tmp_path / name, **{**given, **changes}))
            if not service.catalog.map_ids():
                publish(service.catalog, "hall", "1", service.scratch)
            if "auth" not in changes:
                service.wait_until_loaded()
            return service

        yield start


def ask(service: Service, spots: range) -> None:
    """Asks from these spots, and waits until all of them are counted."""
    before = counted(service)
    for number, spot in enumerate(spots, before + 1):
        assert service.ask("http", body=BODIES[spot]).json["verdict"] == "localized"
        wait_until(lambda number=number: counted(service) == number)


def counted(service: Service) -> int:
    changes(service)  # takes the counts from the workers
    return int(service.value("firstfix_sightings_total", result="counted"))


def changes(service: Service, **params: Any) -> dict[str, Any]:
    reply = service.http.get("/maps/hall/changes", params=params)
    assert reply.status_code == 200, reply.text
    return dict(reply.json())


def parts(service: Service) -> list[str]:
    return [key for key in service.catalog.store.list("maps/hall/versions") if "/sightings/" in key]


def is_the_rack(found: dict[str, Any]) -> bool:
    (area,) = found["areas"]
    middle = (np.array(area["box"]["low"]) + area["box"]["high"]) / 2
    return area["kind"] == "gone" and bool(np.abs(middle - [9.75, 5.25, 1.15]).max() < 0.5)


def test_counts_of_two_replicas_add_up(replicas: Callable[..., Service]):
    one, other = replicas("one", sightings_flush_s=0.2), replicas("other", sightings_flush_s=0.2)
    version = one.catalog.active_version("hall")
    assert changes(one) == {
        "map_id": "hall",
        "version": version,
        "cell_m": 0.5,
        "sightings": 0,
        "coverage_known": 0,
        "seen_cells": 0,
        "first_time": None,
        "last_time": None,
        "areas_found": 0,
        "areas": [],
    }
    ask(one, range(3))
    assert changes(one)["areas"] == [], "three spots may be wrong"
    ask(other, range(3, 8))
    wait_until(lambda: changes(one)["sightings"] == changes(other)["sightings"] == 8)
    wait_until(lambda: len(parts(one)) >= 2)
    found = changes(one, cells=True, grid=True)
    assert is_the_rack(found)
    assert changes(other, cells=True, grid=True)["areas"] == found["areas"]
    assert found["areas"][0]["cells"] == len(found["areas"][0]["cell_list"])
    assert found["seen_cells"] == found["grid"]["cells_found"] == len(found["grid"]["confirmed"])
    assert b"points" not in b"".join(one.catalog.store.get(key) for key in parts(one))


def test_counts_are_stored_when_the_replica_stops(tmp_path: Path):
    settings = {"load": load, "zenoh": False, "sightings_flush_s": 3600.0}
    with running_service(tmp_path, **settings) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
        ask(service, range(8))
        assert is_the_rack(changes(service))
        assert parts(service) == []
    with running_service(tmp_path, **settings) as service:
        assert len(parts(service)) == 1
        assert is_the_rack(changes(service))


def test_a_robot_that_stands_still_is_counted_once(replicas: Callable[..., Service]):
    service = replicas("one")
    ask(service, range(1))
    for _ in range(20):
        service.ask("http", body=BODIES[0])
    ask(service, range(1, 2))
    assert changes(service)["sightings"] == 2


def test_a_read_only_service_counts_no_sightings(replicas: Callable[..., Service]):
    replicas("one")
    service = replicas("other", read_only=True)
    service.ask("http", body=BODIES[0])
    assert (counted(service), changes(service)["sightings"]) == (0, 0)


def test_an_unsure_pose_is_not_counted(replicas, monkeypatch):
    service = replicas("one")
    with monkeypatch.context() as patch:
        patch.setattr(KnowsItsPlace, "probability", 0.98)
        service.ask("http", body=BODIES[0])
    ask(service, range(1, 2))
    assert changes(service)["sightings"] == 1


def test_a_retired_version_and_an_unknown_map_have_no_changes(replicas: Callable[..., Service]):
    service = replicas("one")
    first = service.catalog.active_version("hall")
    ask(service, range(1))
    publish(service.catalog, "hall", "2", service.scratch)
    assert changes(service, version=first)["sightings"] == 1
    wait_until(lambda: changes(service)["version"] != first)
    assert changes(service)["sightings"] == 0, "another version, other counts"
    assert service.http.delete(f"/maps/hall/versions/{first}").status_code == 200
    assert service.http.get("/maps/hall/changes", params={"version": first}).status_code == 404
    assert service.http.get("/maps/yard/changes").status_code == 404
    assert service.http.get("/maps/hall/changes", params={"version": "../x"}).status_code == 400
    assert service.http.get("/maps/hall/changes", params={"limit": 0}).status_code == 400


def test_changes_are_shown_to_callers_with_a_key_for_the_map(replicas: Callable[..., Service]):
    service = replicas("one", **KEYED)
    keys = [
        known(service, scope, maps=maps)
        for scope, maps in (("localize", ("hall",)), ("localize", ("yard",)), ("metrics", ("*",)))
    ]

    def status(key: str | None) -> int:
        return get(service, "/maps/hall/changes", key).status_code

    wait_until(lambda: status(keys[0]) == 200)  # the map is loaded
    assert [status(key) for key in (None, *keys)] == [401, 200, 403, 403]


def test_the_command_line_lists_and_draws_changes(replicas, tmp_path):
    service = replicas("one")
    ask(service, range(8))
    picture = tmp_path / "changes.png"
    said = firstfix("maps", "changes", "hall", "--url", service.url, "--picture", picture).out
    assert "8 queries counted" in said
    assert "gone" in said
    assert picture.read_bytes().startswith(b"\x89PNG")
    said = firstfix("maps", "changes", "hall", "--store", service.settings.store, "--json").out
    assert json.loads(said)["areas"] == [], "not in the store yet"


def test_changes_are_computed_once_for_each_state(replicas, monkeypatch):
    made: list[int] = []

    def count(record: SightingsRecord, **more: Any) -> dict[str, Any]:
        made.append(sum(day.tally.sightings for day in record.days.values()))
        return changes_of(record, **more)

    one, other = replicas("one", sightings_flush_s=3600.0), replicas("other", sightings_flush_s=3600.0)
    version = one.catalog.active_version("hall")
    ask(one, range(8))
    monkeypatch.setattr(encoded_changes, "changes_of", count)
    asked = [changes(one)] + [
        changes(one, limit=limit, cells=cells, grid=grid)
        for limit in (1, 3, 1000)
        for cells in (False, True)
        for grid in (False, True)
    ]
    assert asked[0] == changes(one, version=version)
    assert made == []
    assert asked[0]["sightings"] == 8
    assert asked[-1]["grid"]["cells_found"] == asked[0]["seen_cells"]
    assert asked[0]["areas"] == [
        {name: value for name, value in area.items() if name != "cell_list"} for area in asked[-1]["areas"]
    ]
    ask(one, range(8, 9))
    assert changes(one)["sightings"] == 9
    one.app.state.start.parts[MapParts].sightings.flush()
    for _ in range(3):
        assert changes(other)["sightings"] == 9, "a part in the store is seen at once"
        assert changes(one)["sightings"] == 9
    assert made == [9, 9, 9], "a new count, its move to the store, and the other replica"


def test_sightings_beyond_the_queue_are_dropped():
    counter, version = SightingCounter(), ServedVersion("hall", "0" * 64, Path())
    localizer = KnowsItsPlace(MAPPED.index)
    scans = [Scan.from_points(np.zeros((100 + n, 3)) + 5.0) for n in range(len(SPOTS))]
    for number, scan in enumerate(scans):
        T = pose(*SPOTS[number])
        answer = Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.999)
        counter.offer(version, localizer, scan, answer)
    assert counter.take().results == {"dropped": len(SPOTS) - MAX_WAITING}
    counter.close()


@pytest.mark.parametrize("coverage_known", [0, 1])
def test_the_command_line_says_where_new_and_unmapped_parts_are_not_told_apart(coverage_known: int):
    box = {"low": [0, 0, 0], "high": [1, 1, 1]}
    area = {"kind": "new", "box": box, "cells": 1, "share": 1.0, "spots": 3, "last_seen": "2026-01-01T00:00"}
    found = {"map_id": "hall", "version": "0" * 64, "sightings": 3, "last_time": None, "areas": [area]}
    said = "\n".join(lines_of({**found, "areas_found": 1, "coverage_known": coverage_known}))
    assert ("not told apart" in said) == (not coverage_known)
