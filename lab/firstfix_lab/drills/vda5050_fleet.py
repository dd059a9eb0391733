"""Loses vehicles of a fleet that speaks VDA 5050, and restarts their broker: who gets its position back?

    firstfix-lab vda5050_fleet [--vehicles 50] [--lost 0.2] [--restarts 2] [--seed 0] [--json FILE]

A real mosquitto, ``firstfix vda5050-gateway`` as a process of its own, and simulated vehicles, each with its
own connection. Some are lost at the start. Of these some drive first, some drive off while their scan is
searched, some refuse initPosition, some have a scan that is ambiguous, and some have no scan. The broker is
killed and started again. Every lost vehicle ends initialised at its own pose, or is named in the log with its
reason. None is initialised while it drives, nor one that knew its position.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix.wire.scan import encode_scan
from plugins.fleet.tests.vda5050_vehicle import MANUFACTURER, SimulatedVehicle
from tests.fake_service import FakeService
from tests.servers import free_port, running_mosquitto
from tests.waiting import wait_until

VERSIONS = ("2.0.0", "2.1.0", "3.0.0")  # of VDA 5050
MAP_VERSION = "ab" * 32
POINTS = 100  # the scan of vehicle i has so many points and i more: the service tells them apart by it
KINDS = ("plain", "drives first", "drives off", "refuses", "ambiguous", "no scan")
NAMED = {
    "refuses": "initPosition FAILED|initializePosition FAILED",
    "ambiguous": "the scan is ambiguous",
    "no scan": "its scan's URL answers with status 404",
}
FLEETS = """\
fleets:
  trucks:
    topics: uagv/+/{manufacturer}/+
    maps: {{hall: {{map_id: HALL}}}}
    scan: {url}/{{serial}}
    T_base_sensor: [0, 0, 0, 0, 0, 0, 1]
"""


def pose_of(number: int) -> tuple[float, float, float]:
    """x, y in metres and heading in radians of a vehicle."""
    return 0.5 * number, -0.25 * number, 0.05 * number


def answer_of(number: int, kind: str) -> Localization:
    if kind == "ambiguous":
        return Localization(
            Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,), map_id="hall", map_version=MAP_VERSION
        )
    x, y, yaw = pose_of(number)
    T = make_transform(rotation_z(yaw), [x, y, 0.0])
    return Localization(
        Verdict.LOCALIZED, (), T, T, 1e-4 * np.eye(6), 0.99, map_id="hall", map_version=MAP_VERSION
    )


def scan_of(number: int) -> bytes:
    """The scan of a vehicle, which the service tells apart from others."""
    points = np.zeros((POINTS + number, 3), np.float32)
    points[:, 0] = np.arange(len(points))
    return encode_scan(Scan(points))


@contextmanager
def scan_server(get: Callable[[str], bytes | None]) -> Iterator[str]:
    """The URL of a server that gives scans by the last part of the path; None: it has none."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            body = get(self.path.rpartition("/")[2])
            self.send_response(404 if body is None else 200)
            self.send_header("Content-Length", str(len(body or b"")))
            self.end_headers()
            self.wfile.write(body or b"")

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class Fleet:
    """The vehicles: which are lost, and of what kind."""

    def __init__(self, port: int, count: int, lost: int, rng: random.Random) -> None:
        order = rng.sample(range(count), count)
        self.kinds = {number: KINDS[i % len(KINDS)] for i, number in enumerate(order[:lost])}
        versions = {number: VERSIONS[i % len(VERSIONS)] for i, number in enumerate(order)}
        self.vehicles = [
            SimulatedVehicle(
                port,
                f"agv{number}",
                knows=number not in self.kinds,
                version=versions[number],
                refuses=self.kinds.get(number) == "refuses",
            )
            for number in range(count)
        ]
        self.scans_given = 0
        # Held while the gateway has no broker: a vehicle that drives off then cannot tell it in time.
        self.told = threading.Lock()
        self._drove_off: set[int] = set()
        for number, kind in self.kinds.items():
            if kind == "drives first":
                self.vehicles[number].drive(True)

    def scan(self, serial: str) -> bytes | None:
        """The scan of a vehicle; one of its kind drives off before it is answered, once."""
        number = int(serial.removeprefix("agv"))
        kind = self.kinds[number]
        self.scans_given += 1
        if kind == "no scan":
            return None
        if kind == "drives off" and number not in self._drove_off:
            self._drove_off.add(number)
            with self.told:
                self.vehicles[number].drive(True)
        return scan_of(number)

    def stop_driving(self) -> None:
        for number, kind in self.kinds.items():
            if kind in ("drives first", "drives off") and self.vehicles[number].driving:
                self.vehicles[number].drive(False)

    def initialised(self, number: int) -> bool:
        return bool(self.vehicles[number].positions) and self.vehicles[number].knows

    def close(self) -> None:
        for vehicle in self.vehicles:
            vehicle.stop()
        for vehicle in self.vehicles:
            vehicle.close()


def vda5050_fleet(
    folder: Path, *, vehicles: int, lost: int, restarts: int, seed: int = 0, say: Callable[[str], None]
) -> dict[str, Any]:
    """The figures. ``not_ended``, ``while_driving``, ``unasked`` and ``wrong_pose`` are to be empty.

    Args:
        folder: empty; of the broker, the log and the fleets' file.
        restarts: of the broker, at random moments.
    """
    rng, port, log = random.Random(seed), free_port(), folder / "gateway.log"
    stack, broker = ExitStack(), ExitStack()
    with stack, broker:
        broker.enter_context(running_mosquitto(folder, port))
        fleet = Fleet(port, vehicles, lost, rng)
        stack.callback(fleet.close)
        service = FakeService(
            {POINTS + number: answer_of(number, kind) for number, kind in fleet.kinds.items()}
        )
        stack.callback(service.stop)
        url = stack.enter_context(scan_server(fleet.scan))
        (folder / "fleets.yaml").write_text(FLEETS.format(manufacturer=MANUFACTURER, url=url))
        command = [sys.executable, "-m", "firstfix_cli.main", "vda5050-gateway", "--url", service.url]
        command += ["--broker", f"mqtt://127.0.0.1:{port}", "--fleets", str(folder / "fleets.yaml")]
        with log.open("wb") as out:
            gateway = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        stack.callback(end, gateway)
        began = time.monotonic()

        def wait_until_connected(times: int) -> None:
            wait_until(
                lambda: log.read_text().count("connected to the broker") >= times, what=f"the gateway, {log}"
            )

        wait_until_connected(1)
        for number in range(restarts):
            _let_some_end(fleet, number, restarts)
            say(f"restart {number + 1} of the broker after {time.monotonic() - began:.1f} s")
            with fleet.told:
                broker.close()
                time.sleep(rng.uniform(0.1, 1.0))
                broker.enter_context(running_mosquitto(folder, port))
                wait_until_connected(2 + number)
        fleet.stop_driving()

        def ended(number: int, kind: str) -> bool:
            if kind in NAMED:
                return re.search(rf"agv{number}  .*({NAMED[kind]})", log.read_text()) is not None
            if kind == "drives off":
                fleet.stop_driving()
            return fleet.initialised(number)

        wait_until(
            lambda: all(ended(number, kind) for number, kind in fleet.kinds.items()),
            what=f"every lost vehicle to end: {log}",
        )
        took_s = time.monotonic() - began
        gateway.send_signal(signal.SIGTERM)
        code = gateway.wait(60)
        return {
            "vehicles": vehicles,
            "lost": {kind: list(fleet.kinds.values()).count(kind) for kind in KINDS},
            "initialised": sum(fleet.initialised(number) for number in fleet.kinds),
            "named": sum(kind in NAMED for kind in fleet.kinds.values()),
            "restarts": restarts,
            "seconds": round(took_s, 1),
            "exit_code": code,
            "not_ended": [n for n, kind in fleet.kinds.items() if not ended(n, kind)],
            "while_driving": [one.serial for one in fleet.vehicles if one.wrong],
            "unasked": [
                one.serial for n, one in enumerate(fleet.vehicles) if one.bodies and n not in fleet.kinds
            ],
            "wrong_pose": [n for n in fleet.kinds if not _is_right(fleet.vehicles[n], n)],
            "bodies": [(one.version, body) for one in fleet.vehicles for body in one.bodies],
        }


def _let_some_end(fleet: Fleet, number: int, restarts: int) -> None:
    """Wait until a part of the lost vehicles has its position, so that the restart meets others at work."""
    plain = [n for n, kind in fleet.kinds.items() if kind == "plain"]
    wanted = len(plain) * number // restarts
    wait_until(
        lambda: fleet.scans_given > 0 and sum(map(fleet.initialised, plain)) >= wanted,
        what="some to be initialised",
    )


def _is_right(vehicle: SimulatedVehicle, number: int) -> bool:
    x, y, theta = pose_of(number)
    wanted = {"x": x, "y": y, "theta": theta}
    return all(
        abs(one[name] - value) < 1e-6 and one["mapId"] == "HALL"
        for one in vehicle.positions
        for name, value in wanted.items()
    )


def end(process: subprocess.Popen[bytes]) -> None:
    """End a process at once."""
    process.kill()
    process.wait()


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab vda5050_fleet",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--vehicles", type=int, default=50)
    parser.add_argument("--lost", type=float, default=0.2, help="share of them")
    parser.add_argument("--restarts", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = vda5050_fleet(
            Path(folder),
            vehicles=given.vehicles,
            lost=round(given.lost * given.vehicles),
            restarts=given.restarts,
            seed=given.seed,
            say=lambda line: print(line, flush=True),
        )
        print((Path(folder) / "gateway.log").read_text(), flush=True)
    figures["sent"] = len(figures.pop("bodies"))
    print(json.dumps(figures, indent=1))
    if given.json:
        given.json.write_text(json.dumps(figures, indent=1) + "\n")
    wrong = ("not_ended", "while_driving", "unasked", "wrong_pose")
    return int(figures["exit_code"] != 0 or any(figures[name] for name in wrong))
