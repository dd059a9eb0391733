"""Ids of maps, builds, uploads and versions, and names of robots."""

from __future__ import annotations

import re
import uuid
from datetime import datetime, timezone

from .errors import InvalidOption

_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,62}")
_VERSION = re.compile(r"[0-9a-f]{64}")
_ROBOT = re.compile(
    r"[A-Za-z0-9/][A-Za-z0-9._:@/-]{0,63}"
)  # also a ROS namespace, and a serial number of VDA 5050


def check_map_id(map_id: str) -> str:
    """A valid map id.

    Raises:
        InvalidOption: not 1 to 63 of a-z, 0-9, ``_`` and ``-``, starting with a letter or digit.
    """
    return _checked("map id", map_id)


def check_build_id(build_id: str) -> str:
    """A valid build id. It has the same form as a map id.

    Raises:
        InvalidOption: another form.
    """
    return _checked("build id", build_id)


def new_build_id() -> str:
    """A new id. It begins with the time, so that builds sort by age."""
    return f"{datetime.now(timezone.utc):%Y%m%dt%H%M%S%f}-{uuid.uuid4().hex[:8]}"


def check_upload_id(upload_id: str) -> str:
    """A valid upload id. It has the same form as a map id.

    Raises:
        InvalidOption: another form.
    """
    return _checked("upload id", upload_id)


def check_version(version: str) -> str:
    """A valid version: a digest.

    Raises:
        InvalidOption: not 64 lower-case hex characters.
    """
    if not _VERSION.fullmatch(version):
        raise InvalidOption(f"not a map version: {version[:80]!r}")
    return version


def check_robot_name(name: str) -> str:
    """A valid name of a robot, by which people tell it from others.

    Raises:
        InvalidOption: not 1 to 64 of ``A-Z a-z 0-9 . _ : @ / -``, starting with a letter, a digit or ``/``.
    """
    if not is_robot_name(name):
        raise InvalidOption(f"not a robot's name (1 to 64 of A-Z a-z 0-9 . _ : @ / -): {name[:80]!r}")
    return name


def is_robot_name(text: str) -> bool:
    """Whether a text has the form of a robot's name."""
    return _ROBOT.fullmatch(text) is not None


def is_name(text: str) -> bool:
    """Whether a text has the form of a map or build id."""
    return _NAME.fullmatch(text) is not None


def _checked(kind: str, name: str) -> str:
    if not _NAME.fullmatch(name):
        raise InvalidOption(f"not a {kind} (1 to 63 of a-z, 0-9, _ and -): {name[:80]!r}")
    return name
