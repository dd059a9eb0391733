"""What comes from files, from the command line and from strangers at the broker, before it is used."""

from __future__ import annotations

import json
import ssl
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.errors import FirstfixError, InputError, InvalidOption, MalformedData, NotFound, TooLarge
from firstfix.transform import make_transform, rotation_z, yaw_of
from firstfix_fleet.vda5050 import http_scan
from firstfix_fleet.vda5050.broker import BrokerAddress, Login, password_of
from firstfix_fleet.vda5050.fleet_maps import FleetMap
from firstfix_fleet.vda5050.fleets_file import read_fleets
from firstfix_fleet.vda5050.http_scan import fetch_scan
from firstfix_fleet.vda5050.log_lines import MAX_IN_A_SECOND, LogLines
from firstfix_fleet.vda5050.messages import MAX_STATE_BYTES, Connection, Sender, State, read_message
from firstfix_fleet.vda5050.planar_fix import NoFix, PlanarFix, planar_fix
from firstfix_fleet.vda5050.scan_address import ScanAddress
from firstfix_fleet.vda5050.topics import VehicleFilter, VehicleName
from plugins.fleet.tests.vda5050_vehicle import MANUFACTURER, header, state
from tests.every_case import every_case

SENDER = Sender(MANUFACTURER, "agv1")
GOOD = """\
fleets:
  trucks:
    topics: uagv/v2/acme/+
    maps: {hall: {map_id: HALL, versions: {0123456789ab: "7"}}, yard: }
    scan: http://agv-{serial}.example/scan
    T_base_sensor: [0.1, 0, 0.5, 0, 0, 0, 1]
"""


def without(name: str) -> dict[str, Any]:
    message = state()
    del message[name]
    return message


@every_case(
    "body",
    [
        b"",
        b"\xff\xfe",
        b"[]",
        b'{"a":' * 100_000,
        json.dumps(without("driving")).encode(),
        json.dumps(state(driving="no")).encode(),
        json.dumps(state(driving=0)).encode(),
        json.dumps(state(nodeStates={})).encode(),
        json.dumps(state(actionStates=[{"actionId": "x"}])).encode(),
        json.dumps(state(agvPosition={"positionInitialized": "false"})).encode(),
        json.dumps(state(velocity={"vx": float("nan")})).encode(),
        json.dumps(state(version="1.1.0")).encode(),
        json.dumps(state(version="4.0.0")).encode(),
        json.dumps(state(version="2")).encode(),
        json.dumps(state(serial="agv2")).encode(),
        json.dumps(state(lastNodeId="n" * 1000)).encode(),
        json.dumps(state(more="x" * MAX_STATE_BYTES)).encode(),
        json.dumps({**header("agv1"), "connectionState": "ONLINE"}).encode(),
    ],
    ids=lambda body: repr(body[:40]),
)
def test_a_state_that_is_none_is_refused(body: bytes):
    with pytest.raises((MalformedData, TooLarge)) as caught:
        read_message(State, body, SENDER)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("value", "online"),
    [("ONLINE", True), ("OFFLINE", False), ("CONNECTIONBROKEN", False), ("CONNECTION_BROKEN", False)],
)
def test_only_an_online_vehicle_is_connected(value: str, online: bool):
    body = json.dumps({**header("agv1"), "connectionState": value}).encode()
    assert read_message(Connection, body, SENDER).is_online is online


def test_topics_name_vehicles():
    name = VehicleName("site/uagv", "v2", "acme", "agv1")
    assert VehicleName.of_topic("site/uagv/v2/acme/agv1/state") == (name, "state")
    assert name.topic("instantActions") == "site/uagv/v2/acme/agv1/instantActions"
    for topic in ("state", "v2/acme/agv1/state", "uagv/v2//agv1/state", f"uagv/v2/a/{'x' * 600}/state"):
        assert VehicleName.of_topic(topic) is None
    assert VehicleFilter.parse("site/uagv/+/acme/+").matches(name)
    for other in ("uagv/+/acme/+", "site/uagv/v3/acme/+", "site/uagv/+/other/+", "site/uagv/+/acme/agv2"):
        assert not VehicleFilter.parse(other).matches(name)
    for wrong in ("uagv/v2/acme", "uagv/v2/acme/#", "uagv/v2/ac+/x", "uagv/v1/acme/+", "uagv//acme/+"):
        with pytest.raises(InvalidOption):
            VehicleFilter.parse(wrong)


@every_case(
    "template, serial, address",
    [
        ("mqtt:scans/{manufacturer}/{serial}", "agv1", "scans/acme/agv1"),
        ("http://robots/{serial}/scan?as={manufacturer}", "agv1", "http://robots/agv1/scan?as=acme"),
        ("http://robots/{serial}/scan", "a/../b?c#d", "http://robots/a%2F..%2Fb%3Fc%23d/scan"),
        ("http://robots?of={serial}", "a&b", "http://robots?of=a%26b"),
        ("http://robots/{serial}/scan", "..", None),
        ("http://{serial}.robots:8080/scan", "agv1", "http://agv1.robots:8080/scan"),
        ("http://{serial}.robots/scan", "evil.example/", None),
        ("http://{serial}.robots/scan", "user@evil", None),
        ("http://{serial}/scan", "169.254.169.254", None),
        ("http://{serial}/scan", "2852039166", None),
        ("http://{serial}/scan", "0x7f000001", None),
        ("http://{serial}/scan", "agv1", "http://agv1/scan"),
    ],
)
def test_a_vehicles_names_stay_within_the_address_of_its_scan(
    template: str, serial: str, address: str | None
):
    vehicle = VehicleName("uagv", "v2", "acme", serial)
    if address is None:
        with pytest.raises(InvalidOption):
            ScanAddress(template).of(vehicle)
    else:
        assert ScanAddress(template).of(vehicle) == address


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("trucks:", "trucks: [", "not YAML"),
        ("scan:", "scam:", "scan"),
        ("http://agv-{serial}", "ftp://{serial}", "neither mqtt:TOPIC nor"),
        ("{serial}", "{name}", "none of"),
        ("-{serial}", "", "without {serial}"),
        ("uagv/v2/acme/+", "uagv/v2", "interfaceName"),
        ("hall:", "Hall!:", "map id"),
        ("0, 0, 0, 1]", "0, 0, 0, 0]", "T_base_sensor"),
        ("0123456789ab", "'0123'", "versions"),
        ("map_id: HALL", "T_vda_map: [0, .nan, 0]", "T_vda_map"),
        ("fleets:", "fleet:", "fleets"),
    ],
)
def test_a_fleets_file_that_cannot_be_used_is_refused_with_the_place(
    tmp_path: Path, old: str, new: str, says: str
):
    file = tmp_path / "fleets.yaml"
    file.write_text(GOOD)
    [(name, entry)] = read_fleets(file).items()
    assert (name, list(entry.maps)) == ("trucks", ["hall", "yard"])
    assert old in GOOD
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(InvalidOption, match=r"fleets\.yaml") as caught:
        read_fleets(file)
    assert says in str(caught.value)


def test_the_documented_fleets_can_be_read(tmp_path: Path):
    page = (Path(__file__).parents[4] / "docs/how-to/vda5050.md").read_text()
    file = tmp_path / "fleets.yaml"
    file.write_text(page.partition("```yaml\n")[2].partition("```")[0])
    fleets = read_fleets(file)
    assert list(fleets) == ["trucks", "tuggers"]
    assert list(fleets["trucks"].maps) == ["hall", "yard"]


def test_brokers_and_passwords(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert BrokerAddress.parse("mqtt://broker") == BrokerAddress("broker", 1883, False)
    assert BrokerAddress.parse("mqtts://broker:99/") == BrokerAddress("broker", 99, True)
    for wrong in ("broker", "http://broker", "mqtt://", "mqtt://b:x", "mqtt://u:secret@b", "mqtt://b/topic"):
        with pytest.raises(InvalidOption) as caught:
            BrokerAddress.parse(wrong)
        assert "secret" not in str(caught.value)
    monkeypatch.setenv("FIRSTFIX_MQTT_PASSWORD", "of the environment")
    assert password_of(None) == "of the environment"
    file = tmp_path / "password"
    with pytest.raises(NotFound):
        password_of(file)
    file.write_text("of the file\n")
    assert password_of(file) == "of the file"
    file.write_text("\n")
    with pytest.raises(InvalidOption):
        password_of(file)
    with pytest.raises(InvalidOption, match="no-such"):
        Login("id", ca=tmp_path / "no-such.pem").tls()


def localized(T: Any, **more: Any) -> Localization:
    base = {"map_id": "hall", "map_version": "ab", "T_map_base": T, "covariance": np.eye(6), **more}
    return Localization(Verdict.LOCALIZED, (), T, **base)


def test_only_what_the_promise_covers_becomes_a_pose_in_the_plane():
    T = make_transform(rotation_z(-3.0), [1.0, 2.0, 30.0])
    assert planar_fix(localized(T), 10) == PlanarFix("hall", "ab", 1.0, 2.0, pytest.approx(-3.0))
    c, s = np.cos(np.radians(9)), np.sin(np.radians(9))
    pitch = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    tilted = make_transform(rotation_z(0.5) @ pitch, [0, 0, 0])
    assert planar_fix(localized(tilted), 10).theta_rad == pytest.approx(0.5)
    free = (FreeDirection(Motion.TRANSLATION, np.array([1.0, 0, 0]), 3.0),)
    refused = {
        "tilted": planar_fix(localized(tilted), 8),
        "upside": planar_fix(localized(np.diag([1.0, -1.0, -1.0, 1.0])), 90),
        "provisional": planar_fix(localized(T, map_provisional=True), 10),
        "free (translation)": planar_fix(localized(T, degenerate=free), 10),
        "of its sensor": planar_fix(localized(T, T_map_base=None), 10),
        "ambiguous (several_places)": planar_fix(
            Localization(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,), probability=0.99), 10
        ),
    }
    for says, one in refused.items():
        assert isinstance(one, NoFix), says
        assert says in one.reason or says == "upside"


def test_a_fix_gets_the_coordinates_of_the_vehicles_map():
    fix = PlanarFix("hall", "ab", 1.0, 2.0, 3.0)
    turned = FleetMap("HALL", T_vda_map=(100.0, 50.0, np.pi / 2)).place(fix)
    T = make_transform(rotation_z(np.pi / 2), [100.0, 50.0, 0.0])
    expected = T @ make_transform(rotation_z(3.0), [1.0, 2.0, 0.0])
    assert (turned.x_m, turned.y_m) == pytest.approx(tuple(expected[:2, 3]))
    assert turned.theta_rad == pytest.approx(yaw_of(expected))
    assert FleetMap("HALL").place(fix) == fix


def test_strangers_fill_no_log():
    now, lines = [0.0], []
    log = LogLines(lambda name, line: lines.append((name, line)), lambda: now[0])
    for number in range(10_000):
        log.write("a\nb", f"\x1b[2J{number}" + "x" * 10_000)
    assert len(lines) == MAX_IN_A_SECOND
    assert all(name == "a?b" and len(line) < 600 and line.isprintable() for name, line in lines)
    now[0] = 1.0
    log.write("", "again")
    assert lines[-2][1].startswith(f"{10_000 - MAX_IN_A_SECOND} lines were left out")


class _Host(BaseHTTPRequestHandler):
    """Paths name what goes wrong."""

    asked: list[str] = []  # noqa: RUF012

    def do_GET(self) -> None:
        self.asked.append(self.path)
        if self.path == "/redirect":
            self.send_response(302)
            self.send_header("Location", "/scan")
            self.end_headers()
        elif self.path == "/drip":
            while True:
                try:
                    self.wfile.write(b"H")
                    self.wfile.flush()
                except OSError:
                    return
                time.sleep(0.05)
        elif self.path == "/missing":
            self.send_error(404)
        else:
            self.send_response(200)
            if self.path == "/pcd":
                self.send_header("Content-Type", "application/x-pcd; charset=x")
            self.end_headers()
            self.wfile.write(b"x" * (5000 if self.path == "/large" else 10))

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def host() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Host)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()
    thread.join()


def test_a_scan_over_http_is_bounded_and_leads_nowhere_else(host: str, monkeypatch: pytest.MonkeyPatch):
    tls = ssl.create_default_context()
    assert fetch_scan(f"{host}/scan", "a/b", tls) == (b"x" * 10, "a/b")
    assert fetch_scan(f"{host}/pcd", "a/b", tls)[1] == "application/x-pcd; charset=x"
    monkeypatch.setattr(http_scan, "MAX_SCAN_BYTES", 1000)
    monkeypatch.setattr(http_scan, "TIMEOUT_S", 1.0)
    for path, kind in {"large": TooLarge, "missing": InputError, "redirect": InputError}.items():
        _Host.asked.clear()
        with pytest.raises(kind):
            fetch_scan(f"{host}/{path}", "a/b", tls)
        assert _Host.asked == [f"/{path}"]
    with pytest.raises(ConnectionError, match="did not come"):
        fetch_scan(f"{host}/drip", "a/b", tls)
    with pytest.raises((ConnectionError, FirstfixError)):
        fetch_scan("http://127.0.0.1:1/scan", "a/b", tls)
