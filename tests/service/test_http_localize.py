from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

from service_world import SCAN_BODY, XYZ, Behaviour, Service, publish, running_service, wait_for

HEADERS = {"Content-Type": XYZ}


def test_the_stages_stand_in_server_timing(service: Service):
    response = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=HEADERS)
    stages = [entry.split(";")[0] for entry in response.headers["server-timing"].split(", ")]
    assert stages == list(response.json()["timings_ms"])


def test_a_streamed_body_is_stopped_at_the_limit(tmp_path: Path):
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        while sent < 64 << 20:
            sent += 1 << 16
            yield bytes(1 << 16)

    with running_service(tmp_path, max_body_bytes=100_000, zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        response = service.http.post("/localize?map=hall", content=endless(), headers=HEADERS)
        assert (response.status_code, response.json()["code"]) == (413, "too_large")
        assert sent < 64 << 20, "the rest was not taken"
        wait_for(lambda: "firstfix_body_bytes 0.0" in service.http.get("/metrics").text)


def test_a_body_that_does_not_come_is_given_up(tmp_path: Path):
    never = threading.Event()

    def stalls() -> Iterator[bytes]:
        yield SCAN_BODY[:12]
        never.wait(1.5)
        yield SCAN_BODY[12:]

    with running_service(tmp_path, body_timeout_s=0.3, zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        response = service.http.post("/localize?map=hall", content=stalls(), headers=HEADERS)
        assert response.json()["code"] == "deadline_exceeded"


def test_all_bodies_together_have_a_limit(tmp_path: Path):
    with running_service(tmp_path, max_inflight_bytes=1000, zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        response = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=HEADERS)
        assert (response.status_code, response.json()["code"]) == (503, "overloaded")
        assert service.http.post("/localize?map=hall", content=SCAN_BODY[:600], headers=HEADERS).is_success


def test_overload_names_when_to_come_back(tmp_path: Path):
    behaviour = Behaviour(gate=threading.Event())
    with running_service(tmp_path, behaviour=behaviour, workers=1, queue_size=0, zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        first = threading.Thread(target=service.ask, args=("http",))
        first.start()
        assert behaviour.started.acquire(timeout=10)
        response = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=HEADERS)
        assert response.status_code == 503
        assert int(response.headers["retry-after"]) >= 1
        behaviour.gate.set()
        first.join()


def test_doubled_options_and_bad_map_ids_are_refused(service: Service):
    for query in ("?map=hall&map=hall", "?map=hall&version=a&version=b", "?map=hall,", "?map=hall,a/b"):
        response = service.http.post(f"/localize{query}", content=SCAN_BODY, headers=HEADERS)
        assert (response.status_code, response.json()["code"]) == (400, "invalid_option"), query


def test_one_map_in_all_needs_no_name(service: Service):
    wait_for(lambda: service.http.post("/localize", content=SCAN_BODY, headers=HEADERS).is_success)
    answer = service.http.post("/localize", content=SCAN_BODY, headers=HEADERS).json()
    assert answer["map_id"] == "hall"


def test_too_many_maps_are_refused(service: Service):
    names = ",".join(f"map{n}" for n in range(17))
    response = service.http.post(f"/localize?map={names}", content=SCAN_BODY, headers=HEADERS)
    assert (response.status_code, response.json()["code"]) == (400, "invalid_option")
