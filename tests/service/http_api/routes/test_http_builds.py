"""Lists of builds, and streams of their events."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from firstfix.builds.records import new_status
from firstfix_service.builds.queue import NOBODY_BUILDS
from tests.service.service_world import Service, running_service
from tests.waiting import LIMIT_S, wait_until


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False, max_event_streams=2) as service:
        yield service


def put(service: Service, build_id: str, map_id: str = "hall", state: str = "queued") -> None:
    service.catalog.builds.put(build_id, {"map_id": map_id})
    if state != "queued":
        service.catalog.builds.set_status(build_id, new_status(state, map_id=map_id))


def events(lines: Iterator[str]) -> Iterator[tuple[str, dict]]:
    name = ""
    for line in lines:
        if line.startswith("event: "):
            name = line.removeprefix("event: ")
        elif line.startswith("data: "):
            yield name, json.loads(line.removeprefix("data: "))


def test_builds_come_in_pages_newest_first(recorder: Service):
    for n in range(5):
        put(recorder, f"b{n}", "hall" if n % 2 else "attic", "failed" if n == 3 else "queued")
    first = recorder.http.get("/builds", params={"limit": 2}).json()
    assert [build["build_id"] for build in first["builds"]] == ["b4", "b3"]
    rest = recorder.http.get("/builds", params={"after": first["next"]}).json()
    assert [build["build_id"] for build in rest["builds"]] == ["b2", "b1", "b0"]
    assert rest["next"] is None
    halls = recorder.http.get("/builds", params={"map_id": "hall", "state": "queued"}).json()
    assert [build["build_id"] for build in halls["builds"]] == ["b1"]
    assert recorder.http.get("/builds", params={"state": "lost"}).status_code == 400
    assert recorder.http.get("/builds", params={"map_id": "A/b"}).status_code == 400


def test_a_page_looks_at_so_many_records_and_says_where_to_go_on(
    recorder: Service, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("firstfix_service.http_api.routes.builds.LOOKED_AT", 2)
    for n in range(5):
        put(recorder, f"b{n}", "attic" if n == 0 else "hall")
    found, after, pages = [], "z", 0
    while after is not None:
        page = recorder.http.get("/builds", params={"map_id": "attic", "after": after}).json()
        found += [build["build_id"] for build in page["builds"]]
        after, pages = page["next"], pages + 1
    assert (found, pages) == (["b0"], 3)


def test_events_until_the_end(recorder: Service):
    put(recorder, "b1")

    def work() -> None:
        for progress in (0.2, 0.7):
            status = new_status("running", map_id="hall", stage="simulate", progress=progress)
            recorder.catalog.builds.set_status("b1", status)
            wait_until(lambda told=progress: told in seen)
        recorder.catalog.builds.set_status("b1", new_status("succeeded", map_id="hall", version="a" * 64))

    seen: list[float] = []
    with recorder.http.stream("GET", "/builds/b1/events") as response:
        assert response.headers["content-type"].startswith("text/event-stream")
        assert response.headers["cache-control"] == "no-store"
        lines = response.iter_lines()
        found = events(lines)
        queued = {"build_id": "b1", **new_status("queued", map_id="hall"), "waits_for": NOBODY_BUILDS}
        assert next(found) == ("progress", queued)
        worker = threading.Thread(target=work)
        worker.start()
        rest = []
        for name, told in found:
            rest.append((name, told))
            seen.append(told["progress"])
        worker.join()
    assert {name for name, _ in rest[:-1]} == {"progress"}
    assert [status["progress"] for _, status in rest[:-1]] == [0.2, 0.7]
    name, last = rest[-1]
    assert (name, last["state"], last["version"]) == ("end", "succeeded", "a" * 64)


def test_a_build_that_has_ended_says_so_at_once(recorder: Service):
    put(recorder, "b1", state="failed")
    ((name, _),) = events(iter(recorder.http.get("/builds/b1/events").text.splitlines()))
    assert name == "end"
    assert recorder.http.get("/builds/none/events").status_code == 404


def test_streams_are_bounded_and_given_back(recorder: Service):
    put(recorder, "b1")
    with httpx.Client(base_url=recorder.url, timeout=LIMIT_S) as other:
        with (
            other.stream("GET", "/builds/b1/events") as first,
            other.stream("GET", "/builds/b1/events") as second,
        ):
            streams = [response.iter_lines() for response in (first, second)]
            assert [next(lines) for lines in streams] == ["event: progress"] * 2
            refused = recorder.http.get("/builds/b1/events")
            assert (refused.status_code, refused.json()["code"]) == (503, "overloaded")
        wait_until(lambda: _opens(recorder))


def _opens(service: Service) -> bool:
    with service.http.stream("GET", "/builds/b1/events") as response:
        return response.status_code == 200


def test_silence_is_filled_with_comments(recorder: Service, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("firstfix_service.http_api.event_stream.HEARTBEAT_S", 0.5)
    put(recorder, "b1")
    with recorder.http.stream("GET", "/builds/b1/events") as response:
        assert next(line for line in response.iter_lines() if line.startswith(":")) == ": still there"


def test_a_record_that_is_removed_ends_the_stream(recorder: Service):
    put(recorder, "b1")
    with recorder.http.stream("GET", "/builds/b1/events") as response:
        lines = response.iter_lines()
        assert next(lines) == "event: progress"
        recorder.catalog.store.delete("builds/b1/request.json")
        assert "event: end" not in list(lines)


def test_streams_do_not_keep_the_service_from_stopping(tmp_path: Path):
    with running_service(tmp_path, zenoh=False) as service:
        put(service, "b1")
        stream = service.http.stream("GET", "/builds/b1/events")
        response = stream.__enter__()
        lines = response.iter_lines()
        assert next(lines) == "event: progress"
        service.stop()
        assert "event: end" not in list(lines), "it ended in good order, the build goes on"
        stream.__exit__(None, None, None)
