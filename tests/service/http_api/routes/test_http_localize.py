from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

from tests.service.service_world import SCAN_BODY, XYZ, Behaviour, Service, publish, running_service
from tests.waiting import LIMIT_S, wait_until

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
        wait_until(lambda: "firstfix_body_bytes 0.0" in service.http.get("/metrics").text)


def test_a_body_that_does_not_come_is_given_up(tmp_path: Path):
    with running_service(tmp_path, body_timeout_s=0.3, zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        host, port = urlsplit(service.url).netloc.split(":")
        with socket.create_connection((host, int(port)), timeout=LIMIT_S) as stalls:
            head = f"POST /localize?map=hall HTTP/1.1\r\nHost: {host}\r\nContent-Type: {XYZ}\r\n"
            stalls.sendall(f"{head}Content-Length: {len(SCAN_BODY)}\r\n\r\n".encode() + SCAN_BODY[:12])
            assert stalls.recv(65_536).startswith(b"HTTP/1.1 504 ")


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
        assert behaviour.started.acquire(timeout=LIMIT_S)
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
    wait_until(lambda: service.http.post("/localize", content=SCAN_BODY, headers=HEADERS).is_success)
    answer = service.http.post("/localize", content=SCAN_BODY, headers=HEADERS).json()
    assert answer["map_id"] == "hall"


def test_too_many_maps_are_refused(service: Service):
    names = ",".join(f"map{n}" for n in range(17))
    response = service.http.post(f"/localize?map={names}", content=SCAN_BODY, headers=HEADERS)
    assert (response.status_code, response.json()["code"]) == (400, "invalid_option")
