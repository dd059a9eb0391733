"""Parameters of the node, and their checks. This module does not import ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from firstfix.errors import InvalidOption
from firstfix.ids import check_map_id
from firstfix_client import Client, ZenohClient

from .robot.answerer import Answerer
from .robot.config import GatewayConfig


@dataclass(frozen=True)
class Parameters:
    """Parameters of the node with their defaults; ``config/first_fix.yaml`` explains them."""

    map_id: str = ""
    url: str = "http://localhost:8080"
    zenoh: str = ""
    map_frame: str = "map"
    odom_frame: str = "odom"
    base_frame: str = "base_link"
    imu: bool = True
    own_pose: bool = False
    publish_tf: bool = True
    at_start: bool = True
    retry_s: float = 1.0
    watch_s: float = 0.0
    timeout_s: float = 10.0
    voxel_m: float = 0.25

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """Returns the default of each parameter."""
        return {field.name: field.default for field in fields(cls)}

    @classmethod
    def checked(cls, values: Mapping[str, Any]) -> Parameters:
        """Returns the parameters after checking their values.

        Raises:
            InvalidOption: a value is not allowed.
        """
        parameters = cls(**values)
        check_map_id(parameters.map_id)
        parameters.config()
        if not (parameters.timeout_s > 0 and parameters.voxel_m >= 0):
            raise InvalidOption("voxel_m must be 0 or more, timeout_s must be greater than 0")
        return parameters

    def config(self) -> GatewayConfig:
        """Returns the configuration of the gateway.

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
        )

    def client(self) -> Client | ZenohClient:
        """Returns a client: over zenoh if ``zenoh`` is set, else over HTTP.

        Raises:
            InvalidOption, ServiceUnreachable, ModuleNotFoundError: see the clients.
        """
        voxel_m = self.voxel_m or None
        if self.zenoh:
            return ZenohClient(self.zenoh, timeout_s=self.timeout_s, voxel_m=voxel_m)
        return Client(self.url, timeout_s=self.timeout_s, voxel_m=voxel_m)

    def answerer(self, client: Client | ZenohClient) -> Answerer:
        """Returns the client's ``localize`` for the map."""
        return lambda scan, options: client.localize(scan, map_id=self.map_id, options=options)
