"""Instant actions that the gateway sends: ``initPosition`` (3.0: ``initializePosition``), ``enableMap``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime

from .planar_fix import PlanarFix
from .topics import VehicleName

INIT_POSITION = "initPosition"


@dataclass(frozen=True)
class InstantAction:
    """An instant action.

    Attributes:
        kind: its actionType in version 2.
        parameters: names and values.
    """

    kind: str
    action_id: str
    parameters: tuple[tuple[str, str | float], ...]

    def __str__(self) -> str:
        values = ", ".join(f"{name} {_shown(value)}" for name, value in self.parameters)
        return f"{self.kind} ({values})"

    def message(self, vehicle: VehicleName, version: str, header_id: int, time: datetime) -> bytes:
        """The message ``instantActions`` with this one action.

        Args:
            version: of the protocol, as the vehicle names it.
            header_id: counts the messages of this topic.
            time: in UTC.
        """
        # From 3.0 on an instant action never blocks. Before, HARD keeps the vehicle from driving meanwhile.
        is_new = not version.startswith("2.")
        kind = "initializePosition" if is_new and self.kind == INIT_POSITION else self.kind
        return json.dumps(
            {
                "headerId": header_id,
                "timestamp": time.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
                "version": version,
                "manufacturer": vehicle.manufacturer,
                "serialNumber": vehicle.serial,
                "actions": [
                    {
                        "actionType": kind,  # as the document of 2.0 has it; its schema says actionName
                        "actionId": self.action_id,
                        "blockingType": "NONE" if is_new else "HARD",
                        "actionParameters": [
                            {"key": name, "value": value} for name, value in self.parameters
                        ],
                    }
                ],
            },
            allow_nan=False,
        ).encode()


def init_position(action_id: str, fix: PlanarFix, map_id: str, last_node_id: str) -> InstantAction:
    """The action that gives the vehicle its pose.

    Args:
        map_id: VDA 5050's.
        last_node_id: as the vehicle has it.
    """
    return InstantAction(
        INIT_POSITION,
        action_id,
        (
            ("x", fix.x_m),
            ("y", fix.y_m),
            ("theta", fix.theta_rad),
            ("mapId", map_id),
            ("lastNodeId", last_node_id),
        ),
    )


def enable_map(action_id: str, map_id: str, map_version: str) -> InstantAction:
    """The action that puts a stored version of a map into use."""
    return InstantAction("enableMap", action_id, (("mapId", map_id), ("mapVersion", map_version)))


def _shown(value: str | float) -> str:
    return value[:60] if isinstance(value, str) else f"{value:.2f}"
