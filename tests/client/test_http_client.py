"""The HTTP client against a real server on loopback that behaves and misbehaves on demand."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable

import numpy as np
import pytest
from starlette.responses import Response

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import (
    BuildFailed,
    DeadlineExceeded,
    FirstfixError,
    InvalidOption,
    NotFound,
    Overloaded,
    all_errors,
)
from firstfix.wire import scan as wire
from firstfix_client import Client, RetryPolicy, ServiceUnreachable
from tests.client.answer_server import ok, problem, raw_server
from tests.client.fake_answers import LOCALIZED, REJECTED, SCAN, T_MAP_SENSOR, answer_bytes
from tests.servers import free_port
from tests.waiting import LIMIT_S, let_pass

QUICK = RetryPolicy(attempts=4, first_wait_s=0.01, max_wait_s=0.05)
WHOLE = b'HTTP/1.1 200 OK\r\ncontent-length: 12\r\n\r\n{"maps": []}'


def test_a_fix_is_a_typed_answer(server):
    server.answers = [ok(answer_bytes())]
    with Client(server.url) as client:
        answer = client.localize(
            SCAN, map_id="hall", options=LocalizeOptions(gravity=np.array([0, 0, -1]), max_candidates=5)
        )
    assert answer.verdict is Verdict.LOCALIZED
    np.testing.assert_allclose(answer.T_map_sensor, T_MAP_SENSOR, atol=1e-12)
    assert answer.map_version == LOCALIZED.map_version
    method, path, query, headers, body = server.requests[0]
    assert (method, path) == ("POST", "/localize")
    assert query.pop("deadline_ms").isdigit()
    assert query == {"map": "hall", "gravity": "0.0,0.0,-1.0", "max_candidates": "5"}
    assert headers["content-type"] == wire.MEDIA_TYPE
    sent = wire.decode_scan(body)
    assert np.abs(sent.points - SCAN.points).max() < 0.0051
    assert sent.intensity is None
    assert sent.stamp_s == SCAN.stamp_s


def test_a_robot_is_named_and_a_malformed_name_is_not_sent(server):
    server.answers = [ok(answer_bytes()), ok(answer_bytes())]
    with Client(server.url) as client:
        client.localize(SCAN, map_id="hall", robot="/hall/cart-07")
        client.localize(SCAN, map_id="hall")
        assert [request[3].get("x-robot") for request in server.requests] == ["/hall/cart-07", None]
        with pytest.raises(InvalidOption, match="not a robot's name"):
            client.localize(SCAN, map_id="hall", robot="cart 07")
    assert len(server.requests) == 2


def test_not_localized_is_no_exception(server):
    server.answers = [ok(answer_bytes(REJECTED))]
    answer = Client(server.url).localize(SCAN.points, map_id="hall")
    assert answer.verdict is Verdict.REJECTED
    assert answer.T_map_sensor is None


def test_a_scan_file_is_thinned_and_sent(server, tmp_path):
    server.answers = [ok(answer_bytes())]
    path = tmp_path / "scan.ffscan"
    path.write_bytes(wire.encode_scan(SCAN))
    client = Client(server.url, voxel_m=1.0)
    client.localize(path, map_id="hall")
    assert 0 < len(wire.decode_scan(server.requests[0][4])) < len(SCAN)
    with pytest.raises(NotFound, match=r"nothere\.pcd"):
        client.localize(tmp_path / "nothere.pcd", map_id="hall")


@pytest.mark.parametrize("error", all_errors())
def test_every_code_comes_back_as_its_class(server, error):
    server.answers = [problem(error.code, 418)]
    with pytest.raises(error, match="because") as caught:
        Client(server.url, retry=RetryPolicy(attempts=1)).localize(SCAN, map_id="hall")
    assert type(caught.value) is error
    assert len(server.requests) == 1


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (problem("quantum_flux", 400), "because"),  # a code of the future
        *(
            (ok(body), "this client cannot read")
            for body in (b"<html>", b"[]", b'{"verdict": "maybe"}', b'{"verdict": "localized"}')
        ),
    ],
)
def test_an_unreadable_answer_is_an_error(server, answer, says):
    server.answers = [answer]
    with pytest.raises(FirstfixError, match=says):
        Client(server.url).localize(SCAN, map_id="hall")


def test_a_busy_service_is_asked_again_when_it_says(server):
    server.answers = [problem("overloaded", 503, **{"Retry-After": "1"}), ok(answer_bytes())]
    assert Client(server.url, retry=QUICK).localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    first, second = (int(request[2]["deadline_ms"]) for request in server.requests)
    assert second <= first - 1000  # the service is told what is left, not what there was


@pytest.mark.parametrize(
    ("answer", "error", "requests"),
    [
        (problem("deadline_exceeded", 504), FirstfixError, 1),  # time does not heal it
        (problem("corrupt_version", 503), FirstfixError, 1),
        (problem("overloaded", 503, **{"Retry-After": "3000"}), Overloaded, 1),  # past the deadline
        (problem("overloaded", 503), Overloaded, QUICK.attempts),
    ],
)
def test_an_error_is_retried_while_it_may_heal(server, answer, error, requests):
    server.answers = [answer]
    with pytest.raises(error, match="because"):
        Client(server.url, retry=QUICK, timeout_s=100).localize(SCAN, map_id="hall")
    assert len(server.requests) == requests


def test_a_slow_service_ends_at_the_timeout(server):
    given_up = threading.Event()

    def slow() -> Response:
        assert given_up.wait(LIMIT_S)
        return ok(answer_bytes())

    server.answers = [slow]
    with pytest.raises(DeadlineExceeded, match=r"0\.3 s"):
        Client(server.url, timeout_s=0.3).localize(SCAN, map_id="hall")
    given_up.set()


def test_a_proxy_without_upstream_is_asked_again_only_for_what_repeats(server):
    server.answers = [Response("bad gateway", 502)]
    client = Client(server.url, retry=QUICK)
    with pytest.raises(FirstfixError, match="502"):
        client.maps()
    assert len(server.requests) == QUICK.attempts
    with pytest.raises(FirstfixError, match="502"):
        client.roll_back("hall")
    assert len(server.requests) == QUICK.attempts + 1


def test_a_patch_is_asked_for_once(server):
    server.answers = [ok(b'{"build_id": "b7", "state": "queued"}', 202)]
    assert Client(server.url, retry=QUICK).patch("hall", "propose") == "b7"
    assert server.requests[0][:3] == ("POST", "/maps/hall/patch", {"mode": "propose"})


def test_an_unreachable_service_is_named():
    port = free_port()
    with pytest.raises(ServiceUnreachable, match=str(port)):
        Client(f"http://127.0.0.1:{port}", retry=QUICK).maps()


def test_a_service_that_comes_up_in_time_is_reached():
    port = free_port()  # one that the kernel gave could be another's before the service comes up

    def answer_once() -> None:
        let_pass(0.4)
        with socket.create_server(("127.0.0.1", port)) as late:
            connection, _ = late.accept()
            with connection:
                connection.recv(65_536)
                connection.sendall(WHOLE)

    thread = threading.Thread(target=answer_once, daemon=True)
    thread.start()
    retry = RetryPolicy(attempts=10_000, first_wait_s=0.05, max_wait_s=0.05)
    assert Client(f"http://127.0.0.1:{port}", retry=retry, timeout_s=LIMIT_S).maps() == []
    thread.join(LIMIT_S)


def test_a_connection_that_breaks_mid_answer_is_tried_again():
    served = []

    def answering(length: int) -> Callable[[socket.socket], None]:
        def answer(connection: socket.socket) -> None:
            served.append(connection.recv(65_536))
            connection.sendall(WHOLE[:length])

        return answer

    with raw_server(answering(len(WHOLE) - 11), answering(len(WHOLE))) as url:
        assert Client(url, retry=QUICK).maps() == []
    assert len(served) == 2


def test_maps_and_versions_are_listed_and_activated(server):
    client = Client(server.url)
    server.answers = [ok(b'{"maps": [{"map_id": "hall", "active_version": "aa", "templates": 9}]}')]
    (hall,) = client.maps()
    assert (hall.map_id, hall.active_version, hall.details["templates"]) == ("hall", "aa", 9)
    versions = b'{"versions": [{"version": "aa", "active": true, "published_time": "2025-01-01T00:00:00Z"}]}'
    server.answers = [ok(versions)]
    (version,) = client.versions("hall")
    assert version.active
    server.answers = [ok()]
    client.activate("hall", "aa")
    assert server.requests[-1][:2] == ("POST", "/maps/hall/versions/aa/activate")


def test_an_id_is_quoted_in_the_path(server):
    server.answers = [problem("not_found", 404)]
    with pytest.raises(NotFound):
        Client(server.url).show_map("../builds?x=1")
    assert server.raw_paths == [b"/maps/..%2Fbuilds%3Fx%3D1"]


def test_a_build_is_uploaded_and_followed(server, tmp_path):
    source, trajectory = tmp_path / "map.ply", tmp_path / "poses.txt"
    source.write_bytes(b"ply and so on")
    trajectory.write_text("0 0 0 0 0 0 0 1")
    running = b'{"state": "running", "stage": "simulate", "progress": 0.5, "map_id": "hall"}'
    done = b'{"state": "succeeded", "stage": "publish", "progress": 1, "map_id": "hall", "version": "ff"}'
    server.answers = [ok(status=202, Location="/builds/b-1"), ok(running), ok(running), ok(done)]
    client = Client(server.url)
    status = client.build_map(source, "hall", config={"sensor": "vlp-16"}, trajectory=trajectory)
    assert (status.build_id, status.stage, status.is_final) == ("b-1", "simulate", False)
    seen = []
    assert client.wait_for_build("b-1", progress=seen.append).version == "ff"
    assert [s.state for s in seen] == ["running", "succeeded"]
    method, path, _, headers, body = server.requests[0]
    assert (method, path) == ("POST", "/maps")
    assert headers["content-type"].startswith("multipart/form-data")
    for part in (b'name="source"; filename="map.ply"', b"ply and so on", b'name="trajectory"', b'"vlp-16"'):
        assert part in body
    assert server.requests[1][1] == "/builds/b-1"


def test_a_failed_build_raises_with_its_reason(server):
    failed = b'{"state": "failed", "error": {"code": "build_failed", "detail": "no floor found"}}'
    server.answers = [ok(failed)]
    with pytest.raises(BuildFailed, match="no floor found"):
        Client(server.url).wait_for_build("b-1")


def test_a_missing_map_file_is_not_uploaded(server, tmp_path):
    with pytest.raises(NotFound):
        Client(server.url).build_map(tmp_path / "map.ply", "hall")
    assert server.requests == []


@pytest.mark.parametrize(
    "url", ["localhost:8080", "ftp://host", "http://", "tcp/localhost:7447", "http://a:b"]
)
def test_an_invalid_url_is_refused(url):
    with pytest.raises(InvalidOption):
        Client(url)
