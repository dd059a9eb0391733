"""A lost vehicle at a real broker gets the pose that the engine finds in a real version."""

from __future__ import annotations

import math
import threading
from pathlib import Path

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix.transform import from_quaternion, inverse, yaw_of
from firstfix.wire.scan import encode_scan
from firstfix_cli.answerer import answerer
from firstfix_fleet.vda5050.broker import Broker, BrokerAddress, Login
from firstfix_fleet.vda5050.fix_seeker import Fleet
from firstfix_fleet.vda5050.fleets_file import FleetEntry
from firstfix_fleet.vda5050.gateway import Gateway
from plugins.fleet.tests.vda5050_vehicle import MANUFACTURER, SimulatedVehicle
from tests.servers import free_port, running_mosquitto

MOUNTING = [0.3, 0.0, 0.8, 0.0, 0.0, 1.0, 0.0]  # it looks back


def test_a_lost_vehicle_gets_its_true_pose(
    small_version, small_scans, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    store, port, stop = tmp_path / "store", free_port(), threading.Event()
    Catalog(Store.open(str(store))).publish("yard", small_version.directory, small_version.manifest)
    T_base_sensor = from_quaternion(MOUNTING[:3], MOUNTING[3:])
    with (
        running_mosquitto(tmp_path, port),
        answerer("yard", url=None, zenoh=None, store=str(store), timeout_s=60, follow=print) as ask,
    ):
        options = LocalizeOptions(T_base_sensor=T_base_sensor)
        scan, T_map_sensor = next(
            (scan, T) for scan, T in small_scans if ask(scan, options).verdict is Verdict.LOCALIZED
        )
        entry = FleetEntry(
            topics=f"uagv/+/{MANUFACTURER}/+",
            maps={"yard": {"map_id": "YARD"}},
            scan="mqtt:scans/{serial}",
            T_base_sensor=MOUNTING,
        )
        broker = Broker(BrokerAddress("127.0.0.1", port, False), Login("gateway"), version=5, log_line=print)
        gateway = Gateway(
            [Fleet("yard", entry, ask)],
            broker.publish,
            broker.subscribe,
            broker.unsubscribe,
            lambda vehicle, line: print(vehicle, line),
        )
        thread = threading.Thread(target=broker.run, args=(gateway, stop), daemon=True)
        thread.start()
        lidar = Client(CallbackAPIVersion.VERSION2)
        lidar.connect("127.0.0.1", port)
        lidar.loop_start()
        vehicle = SimulatedVehicle(port, "agv1", knows=False)
        try:
            while not vehicle.positions:
                lidar.publish("scans/agv1", encode_scan(scan))
                assert not stop.wait(0.5)
        finally:
            vehicle.close()
            lidar.disconnect()
            lidar.loop_stop()
            stop.set()
            thread.join()
            gateway.close()
    [position] = vehicle.positions
    T_map_base = T_map_sensor @ inverse(T_base_sensor)
    assert math.hypot(position["x"] - T_map_base[0, 3], position["y"] - T_map_base[1, 3]) < 0.1
    assert abs(math.remainder(position["theta"] - yaw_of(T_map_base), 2 * math.pi)) < math.radians(1)
    assert position["mapId"] == "YARD"
