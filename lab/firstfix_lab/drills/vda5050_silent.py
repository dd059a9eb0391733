"""Loses vehicles that send no scan, and then one that does: how long does it wait behind them?

    firstfix-lab vda5050_silent [--silent 150] [--json FILE]

A real mosquitto, ``firstfix vda5050-gateway`` as a process of its own, and a stranger who invents vehicles.
They are online, lost, and silent on their scans' topics. The real vehicle is lost when the gateway knows of
them. It is to be initialised before those that came first have all been given up.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from plugins.fleet.tests.vda5050_vehicle import MANUFACTURER, SimulatedVehicle, header, state
from tests.fake_service import FakeService
from tests.servers import free_port, running_mosquitto
from tests.waiting import let_pass, wait_until

from .vda5050_fleet import POINTS, answer_of, end, scan_of

STATES_EVERY_S, SCANS_EVERY_S = 10.0, 0.2
AHEAD_S = 4.0  # of the real vehicle: the gateway waits for scans of the silent ones after 2 s
FLEETS = f"""\
fleets:
  trucks:
    topics: uagv/+/{MANUFACTURER}/+
    maps: {{hall: {{map_id: HALL}}}}
    scan: mqtt:scans/{{serial}}
    T_base_sensor: [0, 0, 0, 0, 0, 0, 1]
"""


class Stranger:
    """Somebody at the broker who invents lost vehicles, and sends the scans of a real one.

    Args:
        scan: of vehicle ``agv0``.
    """

    def __init__(self, port: int, count: int, scan: bytes) -> None:
        self._serials, self._scan = [f"silent{number}" for number in range(count)], scan
        self._client = Client(CallbackAPIVersion.VERSION2, "stranger")
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._client.disconnect()
        self._client.loop_stop()

    def _run(self) -> None:
        for serial in self._serials:
            self._publish(serial, "connection", {**header(serial), "connectionState": "ONLINE"})
        next_states_s = 0.0
        while not self._stop.wait(SCANS_EVERY_S):
            if time.monotonic() >= next_states_s:
                next_states_s = time.monotonic() + STATES_EVERY_S
                for serial in self._serials:
                    self._publish(serial, "state", state(serial))
            self._client.publish("scans/agv0", self._scan)

    def _publish(self, serial: str, kind: str, message: dict[str, Any]) -> None:
        self._client.publish(f"uagv/v2/{MANUFACTURER}/{serial}/{kind}", json.dumps(message))


def vda5050_silent(folder: Path, *, silent: int, say: Callable[[str], None]) -> dict[str, Any]:
    """The figures. ``given_up`` is the number of silent vehicles that were given up before the real one.

    Args:
        folder: empty; of the broker, the log and the fleets' file.
    """
    port, log = free_port(), folder / "gateway.log"
    with ExitStack() as stack:
        stack.enter_context(running_mosquitto(folder, port))
        service = FakeService({POINTS: answer_of(0, "plain")})
        stack.callback(service.stop)
        (folder / "fleets.yaml").write_text(FLEETS)
        command = [sys.executable, "-m", "firstfix_cli.main", "vda5050-gateway", "--url", service.url]
        command += ["--broker", f"mqtt://127.0.0.1:{port}", "--fleets", str(folder / "fleets.yaml")]
        with log.open("wb") as out:
            gateway = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        stack.callback(end, gateway)
        wait_until(lambda: "connected to the broker" in log.read_text(), what=f"the gateway, {log}")
        stack.callback(Stranger(port, silent, scan_of(0)).close)
        wait_until(
            lambda: log.read_text().count("silent") >= min(silent, 1), what="the silent ones to be lost"
        )
        let_pass(AHEAD_S)
        say(f"{silent} silent vehicles are lost")
        began = time.monotonic()
        vehicle = SimulatedVehicle(port, "agv0", knows=False)
        stack.callback(vehicle.close)
        wait_until(lambda: vehicle.positions, what=f"the real vehicle's position: {log}")
        took_s, given_up = time.monotonic() - began, log.read_text().count("no scan came on its topic")
        gateway.send_signal(signal.SIGTERM)
        return {
            "silent": silent,
            "given_up": given_up,
            "first_position_s": round(took_s, 1),
            "exit_code": gateway.wait(60),
        }


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab vda5050_silent",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--silent", type=int, default=150)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = vda5050_silent(Path(folder), silent=given.silent, say=lambda line: print(line, flush=True))
    print(json.dumps(figures, indent=1))
    if given.json:
        given.json.write_text(json.dumps(figures, indent=1) + "\n")
    return int(figures["exit_code"] != 0 or figures["given_up"] * 2 > given.silent)
