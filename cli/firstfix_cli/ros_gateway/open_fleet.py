"""A fleet's gateway by the options of the command: on DDS or on rmw_zenoh."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from firstfix.errors import InvalidOption
from firstfix_ros.robot.answerer import Answerer
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.topics import Topics

ROUTER = "tcp/localhost:7447"


class Fleet(Protocol):
    """The gateway of a fleet of robots."""

    def run(self, stop: threading.Event) -> None:
        """Blocks until ``stop`` is set."""
        ...


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
) -> Iterator[tuple[str, Fleet]]:
    """Gives where the robots are looked for, and their gateway.

    Raises:
        InvalidOption: ``connect`` is given for DDS, or an option cannot be used.
        ModuleNotFoundError: the package of the middleware is not installed.
        ServiceUnreachable: no zenoh router.
    """
    if dds:
        if connect is not None:
            raise InvalidOption("--connect names a zenoh router; robots on DDS are found without it")
        yield _dds_fleet(ask, config, topics, domain, log_line)
        return
    from .fleet import RosGateway, open_session

    with open_session(connect or ROUTER) as session:
        yield (
            f"at {connect or ROUTER}",
            RosGateway(session, ask, config, domain=domain, topics=topics, log_line=log_line),
        )


def _dds_fleet(
    ask: Answerer, config: GatewayConfig, topics: Topics, domain: int, log_line: Callable[[str, str], None]
) -> tuple[str, Fleet]:
    try:
        from .dds.fleet import DdsFleet
        from .dds.participant import Participant
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "cyclonedds":
            raise
        raise ModuleNotFoundError(
            "DDS needs the package cyclonedds: pip install 'firstfix[dds]'", name=error.name
        ) from None
    return "on DDS", DdsFleet(Participant(domain), ask, config, topics=topics, log_line=log_line)
