"""The gateway at a real broker: TLS, password, last will, hostile messages, scans on topics."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix.wire.scan import encode_scan
from firstfix_fleet.vda5050 import broker as broker_module
from firstfix_fleet.vda5050 import gateway as gateway_module
from firstfix_fleet.vda5050.broker import PRESENCE, Broker, BrokerAddress, Login
from firstfix_fleet.vda5050.fix_seeker import Fleet
from firstfix_fleet.vda5050.fleets_file import FleetEntry
from firstfix_fleet.vda5050.gateway import Gateway
from firstfix_fleet.vda5050.vehicle import Patience
from plugins.fleet.tests.vda5050_vehicle import MANUFACTURER, SimulatedVehicle, header, state
from tests.certificates import certificates
from tests.servers import free_port, program, running_mosquitto
from tests.waiting import wait_until

T_MAP_BASE = make_transform(rotation_z(0.5), [12.0, -4.0, 0.3])
MOUNTING = [0.2, 0.0, 0.7, 0.0, 0.0, 0.0, 1.0]
SCAN = encode_scan(Scan(np.eye(3, dtype=np.float32).repeat(50, 0) * 5))


def entry(scan: str) -> FleetEntry:
    return FleetEntry(
        topics=f"uagv/+/{MANUFACTURER}/+", maps={"hall": None}, scan=scan, T_base_sensor=MOUNTING
    )


def found(scan: object, options: LocalizeOptions) -> Localization:
    assert options.T_base_sensor is not None
    assert options.T_base_sensor[:3, 3].tolist() == MOUNTING[:3]
    return Localization(
        Verdict.LOCALIZED, (), T_MAP_BASE, T_MAP_BASE, np.eye(6) * 1e-4, map_id="hall", map_version="ab" * 32
    )


@contextmanager
def at_broker(port: int, scan: str, lines: list[str], version: int = 5) -> Iterator[Gateway]:
    """A gateway in a thread."""
    address = BrokerAddress("127.0.0.1", port, False)
    broker = Broker(address, Login("gateway"), version=version, log_line=lines.append)
    gateway = Gateway(
        [Fleet("trucks", entry(scan), found)],
        broker.publish,
        broker.subscribe,
        broker.unsubscribe,
        lambda vehicle, line: lines.append(f"{vehicle}  {line}"),
        patience=Patience(settle_s=0.2),
    )
    stop = threading.Event()
    thread = threading.Thread(target=broker.run, args=(gateway, stop), daemon=True)
    thread.start()
    try:
        yield gateway
    finally:
        stop.set()
        thread.join()
        gateway.close()


@contextmanager
def client(port: int, set_up: Callable[[Client], object] = lambda one: None) -> Iterator[Client]:
    """Somebody else at the broker."""
    one = Client(CallbackAPIVersion.VERSION2)
    set_up(one)
    ready = threading.Event()
    one.on_connect = lambda *_: ready.set()
    one.connect("127.0.0.1", port)
    one.loop_start()
    assert ready.wait(60)
    try:
        yield one
    finally:
        one.disconnect()
        one.loop_stop()


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    port = free_port()
    with running_mosquitto(tmp_path, port):
        yield port


@pytest.mark.parametrize("version", [5, 3])
def test_a_scan_on_a_topic_is_taken_when_it_is_wanted_and_only_if_it_is_new(port: int, version: int):
    lines: list[str] = []
    with client(port) as other, at_broker(port, "mqtt:scans/{serial}", lines, version) as gateway:
        other.publish("scans/agv1", b"of yesterday", retain=True).wait_for_publish(60)
        vehicle = SimulatedVehicle(port, "agv1", knows=False)
        try:
            wait_until(lambda: gateway._seeker.topics() == ["scans/agv1"])
            while not vehicle.positions:
                other.publish("scans/agv1", SCAN)
                vehicle._stop.wait(0.2)
            wait_until(lambda: gateway.lines == {"uagv/v2/acme/agv1": "knows its position"})
            assert gateway._seeker.topics() == []
        finally:
            vehicle.close()
    [position] = vehicle.positions
    assert position == {
        "x": 12.0,
        "y": -4.0,
        "theta": pytest.approx(0.5),
        "mapId": "hall",
        "lastNodeId": "node7",
    }


def test_wrong_messages_are_told_and_left_alone(port: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(broker_module, "MAX_PACKET_BYTES", 3 << 20)
    lines: list[str] = []
    sizes, take = [], Gateway.take

    def measured(gateway: Gateway, topic: str, body: bytes, *, retained: bool) -> None:
        sizes.append(len(body))
        take(gateway, topic, body, retained=retained)

    monkeypatch.setattr(Gateway, "take", measured)
    base, lost = f"uagv/v2/{MANUFACTURER}/agv1", json.dumps(state()).encode()
    with client(port) as other:  # it was sent before the gateway comes
        old = json.dumps(state("agv9")).encode()
        other.publish(f"uagv/v2/{MANUFACTURER}/agv9/state", old, 1, retain=True).wait_for_publish(60)
    with client(port) as other, at_broker(port, "mqtt:scans/{serial}", lines):

        def is_heard() -> bool:
            other.publish(f"{base}/state", lost)
            return f"{base}  lost: it has not said that it is ONLINE" in lines

        wait_until(is_heard)
        bad = {
            f"{base}/state": [b"", b"{", b"\x00" * (2 << 20), json.dumps(state(serial="agv2")).encode()],
            f"{base}/connection": [json.dumps({**header("agv1"), "connectionState": 1}).encode()],
            f"uagv/v1/{MANUFACTURER}/agv1/state": [lost],  # of no fleet's major version
            f"uagv/v2/other/agv1/state": [lost],  # noqa: F541
            f"{base}/instantActions": [b"{"],
            "elsewhere": [b"{"],
            f"{base}/order": [b"\x00" * (4 << 20), b"{"],  # the broker leaves the first one out
        }
        for topic, bodies in bad.items():
            for body in bodies:
                other.publish(topic, body, qos=1).wait_for_publish(60)
        complaints = [
            "left alone: not a state of VDA 5050: Invalid JSON",
            "left alone: a state of 2097152 bytes",
            "left alone: a state that says that it is of the vehicle 'acme' 'agv2'",
            "left alone: not a connection of VDA 5050: connectionState",
        ]
        wait_until(lambda: all(any(one in line for line in lines) for one in complaints))
        assert max(sizes) == 2 << 20, "what is larger than the limit never comes"
        assert not any("defect" in line or "other" in line or "agv9" in line for line in lines), lines
        vehicle = SimulatedVehicle(port, "agv3", knows=False)
        try:
            while not vehicle.positions:  # it works on
                other.publish("scans/agv3", SCAN)
                vehicle._stop.wait(0.2)
        finally:
            vehicle.close()


def test_memory_is_bounded_for_any_number_of_vehicles(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gateway_module, "MAX_VEHICLES", 100)
    now, lines, sent = [0.0], [], []
    gateway = Gateway(
        [Fleet("trucks", entry("mqtt:scans/{serial}"), found)],
        lambda topic, body: bool(sent.append(topic)),
        lambda topic: None,
        lambda topic: None,
        lambda vehicle, line: lines.append(line),
        clock=lambda: now[0],
    )
    for number in range(1000):
        now[0] += 0.1
        serial = f"agv{number}"
        body = json.dumps(state(serial)).encode()
        gateway.take(f"uagv/v2/{MANUFACTURER}/{serial}/state", body, retained=False)
    assert len(gateway.lines) == 100
    assert lines.count("more than 100 vehicles: others are left alone") == 1
    now[0] = 3600.0  # those before are silent: they give their places
    body = json.dumps(state("new")).encode()
    gateway.take(f"uagv/v2/{MANUFACTURER}/new/state", body, retained=False)
    assert list(gateway.lines) == [f"uagv/v2/{MANUFACTURER}/new"]
    gateway.close()
    assert not sent


class Nothing:
    """A listener that does nothing."""

    def connected(self) -> None: ...
    def disconnected(self) -> None: ...
    def tick(self) -> None: ...
    def take(self, topic: str, body: bytes, *, retained: bool) -> None: ...


def test_the_command_with_tls_and_a_password_shows_where_it_is(tmp_path: Path):
    port = free_port()
    ca, server, _ = certificates(tmp_path)
    (tmp_path / "password").write_text("right\n")
    maker = program("mosquitto_passwd", "comes with mosquitto")
    subprocess.run([maker, "-b", "-c", str(tmp_path / "users"), "gateway", "right"], check=True)
    (tmp_path / "fleets.yaml").write_text(
        "fleets: {trucks: {topics: uagv/v2/acme/+, maps: {hall: }, scan: 'mqtt:scans/{serial}', "
        "T_base_sensor: [0, 0, 0, 0, 0, 0, 1]}}"
    )
    options = [f"cafile {ca}", f"certfile {server}", f"keyfile {server}", "allow_anonymous false"]
    command = [sys.executable, "-m", "firstfix_cli.main", "vda5050-gateway", "--ca", str(ca)]
    command += ["--broker", f"mqtts://127.0.0.1:{port}", "--user", "gateway"]
    command += ["--fleets", str(tmp_path / "fleets.yaml"), "--client-id", "yard-1"]
    seen: list[Any] = []

    def on_message(_: Client, data: object, message: MQTTMessage) -> None:
        seen.append(json.loads(message.payload)["connectionState"])

    def set_up(one: Client) -> None:
        one.username_pw_set("gateway", "right")
        one.tls_set(str(ca))
        one.on_message = on_message

    users = f"password_file {tmp_path / 'users'}"
    with running_mosquitto(tmp_path, port, *options, users, "user root"), client(port, set_up) as other:
        other.subscribe(f"{PRESENCE}/yard-1", 1)
        lines: list[str] = []
        address, login = BrokerAddress("127.0.0.1", port, True), Login("other", "gateway", "wrong", ca=ca)
        refused, stop = Broker(address, login, version=5, log_line=lines.append), threading.Event()
        thread = threading.Thread(target=refused.run, args=(Nothing(), stop), daemon=True)
        thread.start()
        wait_until(lambda: any("refuses: Not authorized" in line for line in lines))
        stop.set()
        thread.join()
        killed = _started([*command, "--password-file", str(tmp_path / "password")], {}, tmp_path / "log")
        wait_until(lambda: seen == ["ONLINE"])
        killed.kill()
        killed.wait()
        wait_until(lambda: seen == ["ONLINE", "CONNECTIONBROKEN"])
        stopped = _started(command, {"FIRSTFIX_MQTT_PASSWORD": "right"}, tmp_path / "log")
        wait_until(lambda: seen[2:] == ["ONLINE"])
        stopped.send_signal(signal.SIGTERM)
        wait_until(lambda: seen[3:] == ["OFFLINE"])
        assert stopped.wait(60) == 0


def _started(command: list[str], environment: dict[str, str], log: Path) -> subprocess.Popen[bytes]:
    with log.open("ab") as out:
        return subprocess.Popen(command, env={**os.environ, **environment}, stdout=out, stderr=out)
