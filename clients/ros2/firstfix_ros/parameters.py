"""Parameters of the node, and their checks. This module does not import ROS."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from firstfix.errors import InvalidOption
from firstfix.ids import check_map_id, is_robot_name
from firstfix_client import Client, ZenohClient

from .on_board.local_localizer import LocalLocalizer
from .robot.answerer import Answerer
from .robot.config import GatewayConfig
from .robot.fix_memory import user_memory

MAX_TIME_S = 3600.0
LOCAL = "local"
LOCALIZERS = ("service", LOCAL)


@dataclass(frozen=True)
class Declaration:
    """Description of one parameter of a node. Its type is that of the default.

    Attributes:
        description: one line.
        limits: lowest and highest value; None: any.
        can_change: while the node runs.
    """

    name: str
    default: bool | float | str
    description: str
    limits: tuple[float, float] | None
    can_change: bool


def _of(
    default: Any, description: str, limits: tuple[float, float] | None = None, can_change: bool = False
) -> Any:
    told = {"description": description, "limits": limits, "can_change": can_change}
    return field(default=default, metadata=told)


@dataclass(frozen=True)
class Parameters:
    """Parameters of the node with their defaults and descriptions."""

    map_id: str = _of("", "Id of the map; required.")
    localizer: str = _of("service", "Who answers: service, or local: this machine, by version_folder.")
    version_folder: str = _of("", "Of the localizer local: maps/MAP/versions/VERSION of a store.")
    url: str = _of("http://localhost:8080", "Address of the service, unless zenoh is set.")
    zenoh: str = _of("", "Zenoh endpoint of the service, such as tcp/localhost:7447.")
    map_frame: str = _of("map", "Frame of the published pose.")
    odom_frame: str = _of("odom", "Frame of the robot's odometry.")
    base_frame: str = _of("base_link", "Frame whose pose is published. Empty: the sensor's.")
    imu: bool = _of(True, "Use gravity from the topic imu while the robot is at rest.")
    own_pose: bool = _of(False, "Take poses of the robot's own localization from the topic own_pose.")
    publish_tf: bool = _of(True, "Publish map_frame -> odom_frame after a fix, unless somebody else does.")
    at_start: bool = _of(True, "Search for a fix at start.")
    retry_s: float = _of(1.0, "Seconds between two tries of a search.", (0.0, MAX_TIME_S), can_change=True)
    watch_s: float = _of(
        0.0,
        "Seconds between two checks of the robot's own localization. 0: never.",
        (0.0, MAX_TIME_S),
        can_change=True,
    )
    repeat_s: float = _of(
        5.0,
        "Publish the pose again until the localizer follows, at most so often. 0: once.",
        (0.0, MAX_TIME_S),
    )
    young_s: float = _of(
        10.0,
        "Seconds for which it is repeated without odometry, or to a localizer that is not heard.",
        (0.0, MAX_TIME_S),
    )
    memory: str = _of("", "Folder that keeps the last fix over a restart. Empty: the user's.")
    timeout_s: float = _of(10.0, "Longest wait for an answer, in seconds.", (0.001, MAX_TIME_S))
    voxel_m: float = _of(
        0.25, "Thins scans before they are sent, in metres. 0: all points, to 1 cm.", (0.0, 100.0)
    )

    @classmethod
    def declarations(cls) -> tuple[Declaration, ...]:
        """Parameters that a node declares."""
        defaults = asdict(cls())
        return tuple(Declaration(one.name, defaults[one.name], **one.metadata) for one in fields(cls))

    @classmethod
    def checked(cls, values: Mapping[str, Any]) -> Parameters:
        """The parameters after checking their values.

        Raises:
            InvalidOption: a value is not allowed.
        """
        parameters = cls(**values)
        check_map_id(parameters.map_id)
        parameters.config()
        if parameters.localizer not in LOCALIZERS:
            raise InvalidOption(f"localizer is {' or '.join(LOCALIZERS)}, not {parameters.localizer[:80]!r}")
        if (parameters.localizer == LOCAL) != bool(parameters.version_folder):
            raise InvalidOption("the localizer local has a version_folder, and no other one has")
        if parameters.localizer == LOCAL and parameters.zenoh:
            raise InvalidOption("zenoh is the way to a service, and the localizer local asks none")
        for one in cls.declarations():
            if one.limits is not None:
                lowest, highest = one.limits
                if not lowest <= getattr(parameters, one.name) <= highest:
                    raise InvalidOption(f"{one.name} must be from {lowest:g} to {highest:g}")
        return parameters

    def config(self) -> GatewayConfig:
        """The configuration of the gateway.

        Raises:
            InvalidOption: a value is not allowed.
        """
        return GatewayConfig(
            map_frame=self.map_frame,
            odom_frame=self.odom_frame,
            base_frame=self.base_frame,
            at_start=self.at_start,
            retry_s=self.retry_s,
            watch_s=self.watch_s,
            publishes_tf=self.publish_tf,
            repeat_s=self.repeat_s,
            young_s=self.young_s,
            memory=Path(self.memory) if self.memory else user_memory(_domain()),
        )

    def answerer(self, endings: ExitStack, robot: str = "") -> Answerer:
        """The one that answers: a client's ``localize`` for the map, or the localizer on this machine.

        Args:
            endings: take what ends it.
            robot: its name, which a service is told.

        Raises:
            InvalidOption, ServiceUnreachable, ModuleNotFoundError: see the clients and ``LocalLocalizer``.
            FirstfixError: see ``LocalLocalizer``.
        """
        if self.localizer == LOCAL:
            folder = Path(self.version_folder)
            return endings.enter_context(LocalLocalizer(folder, self.map_id, timeout_s=self.timeout_s))
        client = self._client()
        endings.callback(client.close)
        named = robot if is_robot_name(robot) and robot != "/" else None
        return lambda scan, options: client.localize(scan, map_id=self.map_id, options=options, robot=named)

    def _client(self) -> Client | ZenohClient:
        """A client: over zenoh if ``zenoh`` is set, else over HTTP."""
        voxel_m = self.voxel_m or None
        if self.zenoh:
            return ZenohClient(self.zenoh, timeout_s=self.timeout_s, voxel_m=voxel_m)
        return Client(self.url, timeout_s=self.timeout_s, voxel_m=voxel_m)


def _domain() -> int:
    """The ROS domain of this process."""
    text = os.environ.get("ROS_DOMAIN_ID", "")
    return int(text) if text.isdecimal() else 0
