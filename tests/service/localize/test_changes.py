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
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix_cli.main import run
from firstfix_service.http_api import encoded_changes
from firstfix_service.http_api.parts import MapParts
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.query_workers.sightings.counter import MAX_WAITING, SightingCounter
from tests.changed_hall import Hall, driven, pose, standing
from tests.service.access_world import get, give
from tests.service.service_world import XYZ, Service, publish, running_service
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
# As a mapping run along one side has it, which a screen hides the other side from: a rack stands there.
SCREEN, HIDDEN = (8.0, 1.0, 0.0, 8.4, 9.2, 3.4), (10.3, 3.9, 0.0, 11.4, 6.2, 1.5)
DRIVE_M = np.column_stack([np.linspace(1.5, 6.5, 11), np.full(11, 5.0), np.full(11, 1.0)])
CAME = (3.1, 6.2, 0.0, 4.2, 7.3, 2.3)
SCREENED = Hall(SIZE_M, standing(SCREEN, HIDDEN))


def load(directory: Path) -> Localizer:
    return KnowsItsPlace(MAPPED.index)


@pytest.fixture
def replicas(tmp_path: Path) -> Iterator[Callable[..., Service]]:
    """Starts services over one store."""
    with ExitStack() as stack:

        def start(name: str, **changes: Any) -> Service:
            folder = tmp_path / name
            settings = {"store": str(tmp_path / "store"), "load": load, "zenoh": False, "replica": name}
            return stack.enter_context(running_service(folder, **{**settings, **changes}))

        yield start


def ask(service: Service, spots: range) -> None:
    """Asks from these spots, and waits until all of them are counted."""
    before = counted(service)
    for number, spot in enumerate(spots, 1):
        assert service.ask("http", body=BODIES[spot], media_type=XYZ).json["verdict"] == "localized"
        wait_until(lambda number=number: counted(service) == before + number)


def counted(service: Service, map_id: str = "hall") -> int:
    changes(service, map_id)  # takes the counts from the workers
    lines = service.http.get("/metrics").text.splitlines()
    mark = 'firstfix_sightings_total{result="counted"} '
    return int(float(next(line.removeprefix(mark) for line in lines if line.startswith(mark))))


def changes(service: Service, map_id: str = "hall", **params: Any) -> dict[str, Any]:
    reply = service.http.get(f"/maps/{map_id}/changes", params=params)
    assert reply.status_code == 200, reply.text
    return dict(reply.json())


def is_in(box: tuple[float, ...], area: dict[str, Any]) -> bool:
    """Returns whether most cells of an area lie in a box, 0.3 m around it."""
    middle = (np.array(area["cell_list"]) + 0.5) * 0.5
    inside = (middle > np.array(box[:3]) - 0.3) & (middle < np.array(box[3:]) + 0.3)
    return bool(inside.all(axis=1).mean() > 0.5)


def parts(service: Service) -> list[str]:
    return [key for key in service.catalog.store.list("maps/hall/versions") if "/sightings/" in key]


def is_the_rack(found: dict[str, Any]) -> bool:
    (area,) = found["areas"]
    middle = (np.array(area["box"]["low"]) + area["box"]["high"]) / 2
    return area["kind"] == "gone" and bool(np.abs(middle - [9.75, 5.25, 1.15]).max() < 0.5)


def test_two_replicas_find_together_what_none_finds_alone(replicas: Callable[..., Service]):
    one, other = replicas("one", sightings_flush_s=0.2), replicas("other", sightings_flush_s=0.2)
    version = publish(one.catalog, "hall", "1", one.scratch)
    wait_until(lambda: all(each.http.get("/readyz").json().get("maps") == 1 for each in (one, other)))
    assert changes(one) == {
        "map_id": "hall",
        "version": version,
        "cell_m": 0.5,
        "sightings": 0,
        "told_apart": 0,
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


def test_a_replica_knows_its_own_counts_at_once_and_stores_them_when_it_stops(tmp_path: Path):
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
    publish(service.catalog, "hall", "1", service.scratch)
    wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
    ask(service, range(1))
    for _ in range(20):
        service.ask("http", body=BODIES[0], media_type=XYZ)
    ask(service, range(1, 2))
    found = changes(service)
    assert (found["sightings"], found["areas"]) == (2, [])


def test_a_read_only_service_counts_nothing(replicas: Callable[..., Service]):
    writer = replicas("one")
    publish(writer.catalog, "hall", "1", writer.scratch)
    service = replicas("other", read_only=True)
    wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
    service.ask("http", body=BODIES[0], media_type=XYZ)
    assert (counted(service), changes(service)["sightings"]) == (0, 0)


def test_a_pose_that_is_not_sure_is_not_counted(replicas, monkeypatch):
    service = replicas("one")
    publish(service.catalog, "hall", "1", service.scratch)
    wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
    with monkeypatch.context() as patch:
        patch.setattr(KnowsItsPlace, "probability", 0.98)
        service.ask("http", body=BODIES[0], media_type=XYZ)
    ask(service, range(1, 2))
    assert changes(service)["sightings"] == 1


def test_a_retired_version_and_an_unknown_map_have_none(replicas: Callable[..., Service]):
    service = replicas("one")
    first = publish(service.catalog, "hall", "1", service.scratch)
    wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
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


def test_a_caller_needs_a_key_for_the_map(replicas: Callable[..., Service]):
    service = replicas("one", auth="on", keys_refresh_s=0.1)
    publish(service.catalog, "hall", "1", service.scratch)
    keys = {
        name: give(service, scope, maps=maps)
        for name, scope, maps in (
            ("robot", "localize", ("hall",)),
            ("other", "localize", ("yard",)),
            ("meter", "metrics", ("*",)),
        )
    }

    def status(key: str | None) -> int:
        return get(service, "/maps/hall/changes", key).status_code

    for key in keys.values():  # each is known from the service's next look on
        wait_until(lambda key=key: status(key) != 401)
    wait_until(lambda: status(keys["robot"]) == 200)  # the map too
    assert [status(key) for key in (None, *keys.values())] == [401, 200, 403, 403]


def test_the_command_line_lists_and_draws_them(replicas, tmp_path, capsys):
    service = replicas("one")
    publish(service.catalog, "hall", "1", service.scratch)
    wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
    ask(service, range(8))
    picture = tmp_path / "changes.png"
    with pytest.raises(SystemExit) as ended:
        run(["maps", "changes", "hall", "--url", service.url, "--picture", str(picture)])
    assert not ended.value.code
    said = capsys.readouterr().out
    assert "8 queries counted" in said
    assert "gone" in said
    assert picture.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(SystemExit):
        run(["maps", "changes", "hall", "--store", service.settings.store, "--json"])
    assert json.loads(capsys.readouterr().out)["areas"] == [], "not in the store yet"


@pytest.fixture(scope="module")
def driven_maps() -> dict[str, MapIndex]:
    """Maps of one mapping run through the hall with the screen, with and without its trajectory."""
    return {
        "driven": driven(SCREENED, DRIVE_M),
        "unknown": driven(SCREENED, DRIVE_M, with_seen_free=False),
    }


@pytest.mark.parametrize(("map_id", "kinds"), [("driven", {"new", "unmapped"}), ("unknown", {"new"})])
def test_what_was_never_mapped_is_told_from_what_is_new(
    replicas, driven_maps, capsys, tmp_path, map_id, kinds
):
    """A rack has come on the side of the mapping run, and one stood on the other side all the time."""
    service = replicas("one", load=lambda directory: KnowsItsPlace(driven_maps[map_id]))
    publish(service.catalog, map_id, "1", service.scratch)
    wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
    now = Hall(SIZE_M, standing(SCREEN, HIDDEN, CAME))
    simulator = now.simulator()
    before = counted(service, map_id)
    for number, (x, y) in enumerate(SPOTS):
        scan = now.scan(simulator, pose(x, y), np.random.default_rng(number))
        points = scan.points[: len(scan) // 1000 * 1000 - 1000 + number]
        assert (
            service.ask("http", body=points.tobytes(), media_type=XYZ, map_id=map_id).json["verdict"]
            == "localized"
        )
        wait_until(lambda number=number: counted(service, map_id) == before + number + 1)
    found = changes(service, map_id, cells=True, grid=True)
    assert {area["kind"] for area in found["areas"]} == kinds
    assert found["told_apart"] == (len(SPOTS) if "unmapped" in kinds else 0)
    assert found["sightings"] == len(SPOTS)
    for box, kind in ((CAME, "new"), (HIDDEN, "unmapped" if "unmapped" in kinds else "new")):
        here = [area["kind"] for area in found["areas"] if is_in(box, area)]
        assert here, kind
        assert set(here) == {kind}
    assert any(found["grid"]["unmapped"]) == ("unmapped" in kinds)
    picture = tmp_path / "changes.png"
    with pytest.raises(SystemExit):
        run(["maps", "changes", map_id, "--url", service.url, "--picture", str(picture)])
    said = capsys.readouterr().out
    assert ("unmapped" in said) == ("unmapped" in kinds)
    assert ("not told apart" in said) == ("unmapped" not in kinds)


def test_changes_are_made_once_for_each_state_however_they_are_asked_for(replicas, monkeypatch):
    made: list[int] = []

    def count(record: SightingsRecord, **more: Any) -> dict[str, Any]:
        made.append(sum(day.tally.sightings for day in record.days.values()))
        return changes_of(record, **more)

    one, other = replicas("one", sightings_flush_s=3600.0), replicas("other", sightings_flush_s=3600.0)
    version = publish(one.catalog, "hall", "1", one.scratch)
    wait_until(lambda: all(each.http.get("/readyz").json().get("maps") == 1 for each in (one, other)))
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


def test_what_finds_no_place_is_dropped():
    counter, version = SightingCounter(), ServedVersion("hall", "0" * 64, Path())
    localizer = KnowsItsPlace(MAPPED.index)
    scans = [Scan.from_points(np.zeros((100 + n, 3)) + 5.0) for n in range(len(SPOTS))]
    for number, scan in enumerate(scans):
        T = pose(*SPOTS[number])
        answer = Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.999)
        counter.offer(version, localizer, scan, answer)
    assert counter.take().results == {"dropped": len(SPOTS) - MAX_WAITING}
    counter.close()
