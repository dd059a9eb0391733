"""A vehicle that speaks VDA 5050: its messages, and one with a connection of its own to a real broker."""

from __future__ import annotations

import json
import threading
from datetime import datetime, timezone
from typing import Any

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

MANUFACTURER = "acme"
STATE_EVERY_S = 0.5


def header(serial: str, version: str = "2.1.0", number: int = 1) -> dict[str, Any]:
    """The fields that every message has."""
    return {
        "headerId": number,
        "timestamp": datetime.now(timezone.utc).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "version": version,
        "manufacturer": MANUFACTURER,
        "serialNumber": serial,
    }


def state(
    serial: str = "agv1", version: str = "2.1.0", *, lost: bool = True, **changed: Any
) -> dict[str, Any]:
    """A state of a vehicle that stands still and has nothing to do, as its version has it."""
    position = {"x": 0.0, "y": 0.0, "theta": 0.0, "mapId": "HALL"}
    message = {
        **header(serial, version),
        "orderId": "",
        "orderUpdateId": 0,
        "lastNodeId": "node7",
        "lastNodeSequenceId": 0,
        "nodeStates": [],
        "edgeStates": [],
        "driving": False,
        "actionStates": [],
        "operatingMode": "AUTOMATIC",
        "errors": [],
    }
    if version.startswith("2."):
        message |= {
            "agvPosition": {**position, "positionInitialized": not lost},
            "batteryState": {"batteryCharge": 80.0, "charging": False},
            "safetyState": {"eStop": "NONE", "fieldViolation": False},
        }
    else:
        message |= {
            "mobileRobotPosition": {**position, "localized": not lost},
            "instantActionStates": [],
            "powerSupply": {"stateOfCharge": 80.0, "charging": False},
            "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": False},
        }
    return {**message, **changed}


class SimulatedVehicle:
    """A vehicle at a broker. It sends its state when it changes, and every half second.

    Args:
        knows: its position, from the beginning.
        refuses: initPosition ends as FAILED.

    Attributes:
        positions: parameters of each initPosition that it took.
        wrong: what it was sent while it drove.
        bodies: the messages instantActions, as they came.
    """

    def __init__(
        self, port: int, serial: str, *, knows: bool, version: str = "2.1.0", refuses: bool = False
    ) -> None:
        self.serial, self.version = serial, version
        self.knows, self.refuses, self.driving = knows, refuses, False
        self.positions: list[dict[str, Any]] = []
        self.wrong: list[str] = []
        self.bodies: list[bytes] = []
        self._action_states: list[dict[str, Any]] = []
        self._heard = threading.Condition()
        self._heard_driving = False
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self.interface = f"uagv/v{version[0]}/{MANUFACTURER}/{serial}"
        self._client = Client(CallbackAPIVersion.VERSION2, serial)
        broken = "CONNECTIONBROKEN" if version.startswith("2.") else "CONNECTION_BROKEN"
        self._client.will_set(f"{self.interface}/connection", self._connection(broken), 1, True)
        self._client.reconnect_delay_set(1, 1)
        self._client.on_connect, self._client.on_message = self._on_connect, self._on_message
        self._client.connect("127.0.0.1", port, 10)
        self._client.loop_start()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Begins to close."""
        self._stop.set()

    def close(self) -> None:
        self.stop()
        self._thread.join()
        self._client.disconnect()
        self._client.loop_stop()

    def drive(self, driving: bool) -> None:
        """Drives off or stops. Returns when the broker has passed on the state that says so."""
        with self._lock:
            self.driving = driving
        with self._heard:
            while self._heard_driving != driving and not self._stop.is_set():
                self.send_state()
                self._heard.wait(STATE_EVERY_S)

    def send_state(self) -> None:
        with self._lock:
            name = "actionStates" if self.version.startswith("2.") else "instantActionStates"
            message = state(
                self.serial,
                self.version,
                lost=not self.knows,
                driving=self.driving,
                **{name: self._action_states[-5:]},
            )
            self._client.publish(f"{self.interface}/state", json.dumps(message))

    def _connection(self, value: str) -> bytes:
        return json.dumps({**header(self.serial, self.version), "connectionState": value}).encode()

    def _run(self) -> None:
        while not self._stop.wait(STATE_EVERY_S):
            self.send_state()

    def _on_connect(self, client: Client, *_: Any) -> None:
        client.subscribe([(f"{self.interface}/instantActions", 0), (f"{self.interface}/state", 0)])
        client.publish(f"{self.interface}/connection", self._connection("ONLINE"), 1, True)
        self.send_state()

    def _on_message(self, client: Client, data: Any, message: MQTTMessage) -> None:
        body = json.loads(message.payload)
        if message.topic.endswith("/state"):
            with self._heard:
                self._heard_driving = body["driving"]
                self._heard.notify_all()
            return
        self.bodies.append(bytes(message.payload))
        for action in body["actions"]:
            self._act(action)

    def _act(self, action: dict[str, Any]) -> None:
        shown = {"actionId": action["actionId"], "actionType": action["actionType"]}
        with self._lock:
            if self.driving:
                self.wrong.append(action["actionType"])
            done = not (self.driving or self.refuses)
            self._action_states.append({**shown, "actionStatus": "RUNNING"})
            self.send_state()
            if done:
                self.positions.append({one["key"]: one["value"] for one in action["actionParameters"]})
                self.knows = True
            self._action_states[-1] = {**shown, "actionStatus": "FINISHED" if done else "FAILED"}
            self.send_state()
