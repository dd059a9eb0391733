"""A gateway without the packages of its edge says what to install, and needs nothing of the service."""

from __future__ import annotations

import pytest

from tests.cli.test_entry import check_what_is_said

# Of [service], not of [gateway].
SERVICE = ("faiss", "fastapi", "obstore", "rosbags", "scipy", "yaml", "zenoh")
GATEWAY = ("ros-gateway", "--map", "hall", "--url", "http://localhost:1")


@pytest.mark.parametrize(
    ("missing", "options", "said"),
    [
        # It goes on until it looks for a ROS 2: the extra has all that it needs until then.
        ("rclpy", (), "no ROS 2 for this Python"),
        ("cyclonedds", ("--dds",), "DDS needs the package cyclonedds: pip install './plugins/fleet[dds]'"),
    ],
)
def test_what_is_missing_is_said_with_what_to_install(missing: str, options: tuple[str, ...], said: str):
    check_what_is_said((*SERVICE, missing), (*GATEWAY, *options), said)
