"""zenoh sessions of tests."""

from __future__ import annotations

import json
from typing import Any

import zenoh


def opened(mode: str, role: str, endpoint: str) -> Any:
    """Opens a session that listens or connects (its role) at one endpoint alone."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5(f"{role}/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)
