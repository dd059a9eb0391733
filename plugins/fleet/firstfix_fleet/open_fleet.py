"""A fleet's gateway by the options of the command: by rclpy, on DDS or on rmw_zenoh."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from firstfix.errors import InvalidOption, pip_install
from firstfix_ros.robot.answerer import Answerer
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.topics import Topics


class Fleet(Protocol):
    """The gateway of a fleet of robots."""

    def run(self, stop: threading.Event) -> None:
        """Block until ``stop`` is set."""
        ...


@dataclass(frozen=True)
class OpenFleet:
    """A fleet's gateway, ready to run.

    Attributes:
        place: where the robots are looked for.
        cannot: what this way cannot do; empty: nothing.
    """

    place: str
    fleet: Fleet
    cannot: str = ""


@contextmanager
def open_fleet(
    ask: Answerer,
    config: GatewayConfig,
    topics: Topics,
    *,
    dds: bool,
    connect: str | None,
    domain: int,
    log_line: Callable[[str, str], None],
) -> Iterator[OpenFleet]:
    """Open the gateway of the robots.

    Args:
        dds: by Cyclone DDS, without ROS.
        connect: endpoint of the robots' zenoh router, without ROS. With neither, by rclpy.

    Raises:
        InvalidOption: both are given, or an option cannot be used.
        ModuleNotFoundError: the package of the middleware is not installed, or there is no ROS 2.
        ServiceUnreachable: no zenoh router.
    """
    if dds:
        if connect is not None:
            raise InvalidOption("--connect names a zenoh router; robots on DDS are found without it")
        yield _dds_fleet(ask, config, topics, domain, log_line)
    elif connect is not None:
        from .rmw_zenoh.fleet import RosGateway, open_session

        with open_session(connect) as session:
            gateway = RosGateway(session, ask, config, domain=domain, topics=topics, log_line=log_line)
            yield OpenFleet(f"at {connect}", gateway)
    else:
        yield _rclpy_fleet(ask, config, topics, domain, log_line)


def _rclpy_fleet(
    ask: Answerer, config: GatewayConfig, topics: Topics, domain: int, log_line: Callable[[str, str], None]
) -> OpenFleet:
    try:
        from rclpy.utilities import get_rmw_implementation_identifier

        from firstfix_ros.on_rclpy.fleet import RclpyFleet
    except ImportError as error:  # also a ROS that is sourced for another Python: its C++ part is not found
        raise ModuleNotFoundError(
            f"no ROS 2 for this Python {sys.version_info[0]}.{sys.version_info[1]} ({_first_line(error)}): "
            "source one (. /opt/ros/jazzy/setup.sh) and run its Python, or go without: --dds for robots on "
            "DDS, --connect tcp/localhost:7447 for those on rmw_zenoh",
            name=error.name,
        ) from None
    fleet = RclpyFleet(ask, config, domain=domain, topics=topics, log_line=log_line)
    return OpenFleet(f"by rclpy, {get_rmw_implementation_identifier()}", fleet)


def _first_line(error: ImportError) -> str:
    return next(iter(str(error).splitlines()), "")


def _dds_fleet(
    ask: Answerer, config: GatewayConfig, topics: Topics, domain: int, log_line: Callable[[str, str], None]
) -> OpenFleet:
    try:
        from .dds.fleet import DdsFleet
        from .dds.participant import Participant
        from .dds.trigger_service import CANNOT
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "cyclonedds":
            raise
        raise ModuleNotFoundError(
            f"DDS needs the package cyclonedds: {pip_install('./plugins/fleet[dds]')}", name=error.name
        ) from None
    fleet = DdsFleet(Participant(domain), ask, config, topics=topics, log_line=log_line)
    return OpenFleet("on DDS", fleet, CANNOT)
