"""The C++ client: golden vectors, damaged input, and a real service."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from clients.conformance.generate import FOLDER
from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.errors import DescriptorMismatch, InvalidOption, Overloaded
from firstfix.ids import check_robot_name
from tests.cpp.cpp_build import Build
from tests.service.service_world import Behaviour, Service, publish, running_service

PLACE = {"latitude_deg": 47.05, "longitude_deg": 8.3, "height_m": 480.0, "x_axis_deg": 0.0}
POINTS = 1000  # of the scan that the program sends


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service with the map "hall". It answers x = 1 and y = the number of points in the query."""
    with running_service(tmp_path_factory.mktemp("service"), zenoh=False) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        yield running


@pytest.mark.parametrize("kind", ["optimised_tests", pytest.param("sanitised", marks=pytest.mark.slow)])
def test_the_golden_vectors(kind: str, request: pytest.FixtureRequest):
    done = request.getfixturevalue(kind).run("firstfix_tests", "conformance", FOLDER)
    assert done.returncode == 0, done.stdout + done.stderr
    count = len(json.loads((FOLDER / "index.json").read_text())["vectors"])
    assert f"{count} passed, 0 failed" in done.stdout


@pytest.mark.slow
def test_a_wrong_vector_is_seen(sanitised: Build, tmp_path: Path):
    index = json.loads((FOLDER / "index.json").read_text())
    expected = [vector for vector in index["vectors"] if "body" in vector["expected"]][:2]
    expected[0]["expected"], expected[1]["expected"] = expected[1]["expected"], expected[0]["expected"]
    for name in ("inputs", "bodies"):
        (tmp_path / name).symlink_to(FOLDER / name)
    (tmp_path / "index.json").write_text(json.dumps({**index, "vectors": expected}))
    done = sanitised.run("firstfix_tests", "conformance", tmp_path)
    assert done.returncode == 1
    assert "0 passed, 2 failed" in done.stdout


@pytest.mark.slow
def test_damaged_bytes_and_senseless_calls_are_errors(sanitised: Build):
    done = sanitised.run("firstfix_tests", "hostile", FOLDER)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scan.xyz", "scan.pcd", "text.pcd"])
def test_the_example_localizes_a_file(optimised: Build, service: Service, tmp_path: Path, name: str):
    points = np.random.default_rng(0).uniform(-9, 9, (70, 3)).astype("<f4")
    (tmp_path / name).write_bytes(points.tobytes() if name == "scan.xyz" else pcd(points, name == "text.pcd"))
    done = optimised.run("firstfix_localize", service.url, "hall", tmp_path / name)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "position 1.0000 70.0000 0.0000" in done.stdout


def pcd(points: np.ndarray, text: bool) -> bytes:
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS ring x y z\nSIZE 2 4 4 4\nTYPE U F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA {'ascii' if text else 'binary'}\n"
    ).encode()
    if text:
        return head + b"".join(f"3 {x} {y} {z}\n".encode() for x, y, z in points.tolist())
    return head + b"".join(struct.pack("<H3f", 3, *point) for point in points.tolist())


@pytest.mark.slow
def test_files_of_no_use_are_errors(optimised: Build, service: Service, tmp_path: Path):
    for name, content in {
        "cut.pcd": pcd(np.ones((5, 3), np.float32), False)[:-1],
        "none.pcd": b"FIELDS x y\nDATA binary\n",
        "huge.pcd": b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 99999999\nDATA binary\n",
        "wide.pcd": b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 99999999\nPOINTS 9\nDATA binary\n",
        "odd.xyz": bytes(13),
    }.items():
        (tmp_path / name).write_bytes(content)
        done = optimised.run("firstfix_localize", service.url, "hall", tmp_path / name)
        assert done.returncode == 1, name
        assert re.match(r"firstfix_localize: (malformed_data|unsupported_format|too_large):", done.stderr), (
            name
        )


@pytest.mark.slow
def test_every_form_of_a_query_is_answered(sanitised: Build, service: Service):
    def call(name: str, map_id: str = "hall") -> str:
        return sanitised.run("firstfix_tests", "calls", service.url, name, map_id, 20).stdout.strip()

    assert call("scan") == f"localized 1 {POINTS}"
    verdict, x, returns = call("range_image").split()
    assert (verdict, x) == ("localized", "1")
    assert 0.9 * POINTS < int(returns) <= POINTS
    verdict, x, points = call("compact").split()
    assert (verdict, x) == ("localized", "1")
    assert 100 < int(points) <= POINTS
    assert call("sequence").startswith("localized 1")
    assert call("maps") == f"hall {service.catalog.active_version('hall')}"
    assert call("scan", "yard") == "error not_found"
    assert call("scan", "../maps?x=1&") == "error invalid_option"


@pytest.mark.slow
def test_a_geographic_pose(sanitised: Build, service: Service):
    def call() -> str:
        return sanitised.run("firstfix_tests", "calls", service.url, "geopose", "hall", 20).stdout

    assert call() == "error not_acceptable\n"
    assert service.http.put("/maps/hall/georeference", json=PLACE).status_code == 200
    north_deg = POINTS / 111_200  # y = 1000 m
    latitude, longitude = (float(number) for number in call().split())
    assert latitude == pytest.approx(47.05 + north_deg, abs=1e-4)
    assert longitude == pytest.approx(8.3, abs=1e-4)


@pytest.mark.slow
def test_errors_of_the_service_keep_their_code(sanitised: Build, tmp_path: Path):
    behaviour = Behaviour(raises=DescriptorMismatch("other parameters"))
    with running_service(tmp_path, zenoh=False, behaviour=behaviour) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        done = sanitised.run("firstfix_tests", "calls", running.url, "scan", "hall", 20)
    assert done.stdout == "error descriptor_mismatch\n"
    assert done.returncode == 1


class Asked(NamedTuple):
    path: str
    authorization: str | None
    robot: str | None


@contextmanager
def answering(*answers: tuple[int, dict[str, str], bytes]) -> Iterator[tuple[str, list[Asked]]]:
    """A server that gives these answers and repeats the last one. Yields its URL and the list of requests."""
    asked: list[Asked] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            status, headers, body = answers[min(len(asked), len(answers) - 1)]
            asked.append(Asked(self.path, self.headers.get("Authorization"), self.headers.get("X-Robot")))
            self.send_response(status)
            for name, value in {**headers, "Content-Length": str(len(body))}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *arguments: object) -> None: ...

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/base/", asked
    finally:
        server.shutdown()
        server.server_close()


REJECTED = json.dumps(Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)).to_mapping()).encode()
BUSY = json.dumps({"code": Overloaded.code, "detail": "full"}).encode()


@pytest.mark.slow
def test_a_busy_service_is_asked_again(sanitised: Build):
    with answering((503, {"Retry-After": "0"}, BUSY), (502, {}, b"<html>"), (200, {}, REJECTED)) as (
        url,
        asked,
    ):
        done = sanitised.run(
            "firstfix_tests", "calls", url, "scan", "hall", 20, FIRSTFIX_API_KEY="ffx_secret\n"
        )
    assert done.stdout == "rejected low_inlier_ratio\n", "not localized is no error"
    assert done.returncode == 0
    assert len(asked) == 3
    path = asked[0].path
    assert path.startswith("/base/localize?map=hall&gravity=0%2C0%2C-9.8")
    assert 0 < float(re.search(r"deadline_ms=(\d+)", path).group(1)) <= 20_000
    assert asked[0].authorization == "Bearer ffx_secret"


def test_each_query_names_the_robot_as_the_python_client_does(optimised_tests: Build):
    def call(url: str, name: str) -> str:
        return optimised_tests.run("firstfix_tests", "calls", url, f"as {name}", "hall", 20).stdout

    with answering((200, {}, REJECTED)) as (url, asked):
        for robot in ("/carts/7", "a" * 64, "VDA-0:1@site_2"):
            call(url, robot)
            assert {one.robot for one in asked} == {check_robot_name(robot)}
            assert len(asked) == 4, "scan, sequence, encoded body, geographic"
            asked.clear()
        for name in ("", "-7", "a" * 65, "cart 7", "cart\r\nX-Robot: other", "é"):
            with pytest.raises(InvalidOption):
                check_robot_name(name)
            assert call(url, name) == "error invalid_option\n"
        assert not asked
        optimised_tests.run("firstfix_tests", "calls", url, "scan", "hall", 20)
        assert [one.robot for one in asked] == [None]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answer", "code", "times"),
    [
        ((503, {"Retry-After": "30"}, BUSY), "overloaded", 1),  # the deadline does not allow the wait
        ((200, {}, b"<html>It works!"), "unreadable", 1),
        ((404, {}, b"nothing"), "unreadable", 1),
        ((302, {"Location": "http://127.0.0.1:1/"}, b""), "unreadable", 1),
        ((200, {}, b" " * 16_000_001), "unreadable", 1),
    ],
    ids=["busy for long", "no service", "another server", "a redirect", "a flood"],
)
def test_what_is_worth_no_other_try(sanitised: Build, answer, code: str, times: int):
    with answering(answer) as (url, asked):
        assert sanitised.run("firstfix_tests", "calls", url, "scan", "hall", 10).stdout == f"error {code}\n"
    assert len(asked) == times


@pytest.mark.slow
def test_nobody_there_and_nobody_in_time(sanitised: Build, service: Service, tmp_path: Path):
    def call(url: str) -> str:
        return sanitised.run("firstfix_tests", "calls", url, "scan", "hall", 5).stdout

    assert call("http://127.0.0.1:1") == "error unreachable\n"
    gate = threading.Event()
    with running_service(tmp_path, zenoh=False, behaviour=Behaviour(gate=gate)) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        done = sanitised.run("firstfix_tests", "calls", running.url, "scan", "hall", 0.5)
        gate.set()
    assert done.stdout == "error deadline_exceeded\n"
    for url in ("ftp://host", "http://", "http://a b", "host:8080"):
        assert call(url) == "error invalid_option\n"


@pytest.mark.slow
def test_it_is_found_where_it_was_installed(optimised: Build, tmp_path: Path):
    subprocess.run(["cmake", "--install", optimised.folder, "--prefix", tmp_path / "prefix"], check=True)
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(robot CXX)\nfind_package(firstfix REQUIRED)\n"
        "add_executable(asking asking.cpp)\ntarget_link_libraries(asking firstfix::client)\n"
        "add_executable(on_board on_board.cpp)\n"
        "target_link_libraries(on_board firstfix::version firstfix::encoding)\n"
    )
    (tmp_path / "asking.cpp").write_text(
        "#include <firstfix/client.hpp>\nint main() {\n"
        '  firstfix::Client client("http://localhost:8080");\n  return 0;\n}\n'
    )
    (tmp_path / "on_board.cpp").write_text(
        "#include <firstfix/ros/point_cloud2.hpp>\n#include <firstfix/version/localizer.hpp>\n"
        "#include <cstdio>\nint main() {\n  try {\n"
        '    const firstfix::Localizer here({{"hall", "/none"}, {"yard", "/none"}});\n'
        "    const firstfix::Localization fix = here.localize(firstfix::ros::read_point_cloud2({}).scan);\n"
        "    return std::puts(firstfix::text_of(fix.verdict));\n"
        "  } catch (const firstfix::Error& error) {\n"
        '    return error.code() == "not_found" ? 0 : 1;\n  }\n}\n'
    )
    for command in (
        ["cmake", "-S", tmp_path, "-B", tmp_path / "made", f"-DCMAKE_PREFIX_PATH={tmp_path / 'prefix'}"],
        ["cmake", "--build", tmp_path / "made"],
        [tmp_path / "made" / "asking"],
        [tmp_path / "made" / "on_board"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
