"""How the zenoh session is set up: by the operator's file, or by a few settings."""

from __future__ import annotations

import json
from typing import Any

import zenoh

from firstfix.errors import InvalidOption

from ..settings import Settings

CLIENT_CONNECT_MS = 2000


def session_config(settings: Settings) -> Any:
    """The operator's file as it is, else a peer on the given endpoints that looks for nobody.

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
        config.insert_json5("transport/link/rx/max_message_size", str(settings.zenoh_max_message_bytes))
    except zenoh.ZError as error:
        raise InvalidOption(f"zenoh config: {error}") from None
    return config


def client_config(settings: Settings) -> Any | None:
    """Of a session beside the one of ``session_config``: a client of whom that one connects with; None: it
    connects with nobody.

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
