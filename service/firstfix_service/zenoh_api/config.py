"""Configuration of the zenoh session: the operator's file, or a few settings."""

from __future__ import annotations

import json
from typing import Any

import zenoh

from firstfix.errors import InvalidOption
from firstfix.wire.endpoints import said_by_zenoh

from ..settings import Settings

CLIENT_CONNECT_MS = 2000


def session_config(settings: Settings) -> Any:
    """The operator's file as it is; without a file, a peer on the given endpoints without scouting.

    Raises:
        InvalidOption: the file cannot be read.
    """
    try:
        if settings.zenoh_config is not None:
            config = zenoh.Config.from_file(str(settings.zenoh_config))
        else:
            config = zenoh.Config()
            config.insert_json5("mode", '"peer"')
            config.insert_json5("listen/endpoints", json.dumps(settings.zenoh_listen))
            config.insert_json5("connect/endpoints", json.dumps(settings.zenoh_connect))
            config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/link/rx/max_message_size", str(max_message_bytes(settings)))
    except zenoh.ZError as error:
        raise InvalidOption(f"zenoh config: {said_by_zenoh(error)}") from None
    return config


def max_message_bytes(settings: Settings) -> int:
    """The maximum size of a zenoh message: one that is longer is dropped without an answer.

    A body that is somewhat too large still arrives, so that its sender learns why it is refused.
    """
    return settings.max_body_bytes * 3 // 2


def client_config(settings: Settings) -> Any | None:
    """The config of a second session: a client of the endpoints that ``session_config`` connects to.

    Returns:
        None if that config connects to no endpoint.

    Raises:
        InvalidOption: the file cannot be read.
    """
    config = session_config(settings)
    endpoints = json.loads(config.get_json("connect/endpoints"))
    if not (any(endpoints.values()) if isinstance(endpoints, dict) else endpoints):
        return None
    changes = {
        "mode": "client",
        "listen/endpoints": [],
        "connect/timeout_ms": CLIENT_CONNECT_MS,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
    }
    for name, value in changes.items():
        config.insert_json5(name, json.dumps(value))
    return config
