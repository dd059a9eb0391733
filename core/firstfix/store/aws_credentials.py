"""S3 credentials from a file, read again for each request, so that keys rotate without a restart."""

from __future__ import annotations

import configparser
import os
from collections.abc import Callable, Mapping
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

_NAMES = {
    "access_key_id": "aws_access_key_id",
    "secret_access_key": "aws_secret_access_key",
    "token": "aws_session_token",
}
# obstore asks again when less than five minutes are left: so for every request, at most ten times a second.
_GOOD_FOR = timedelta(minutes=1)


def credentials_file(environment: Mapping[str, str] = os.environ) -> Callable[[], dict[str, Any]] | None:
    """A function that reads the credentials file, or None if the environment names no such file.

    It reads the profile ``AWS_PROFILE`` (``default``) of the file ``AWS_SHARED_CREDENTIALS_FILE``. Keys in
    the environment come first, as in AWS's own tools: then there is no file to read.
    """
    named = environment.get("AWS_SHARED_CREDENTIALS_FILE")
    if not named or environment.get("AWS_ACCESS_KEY_ID"):
        return None
    path, profile = Path(named).expanduser(), environment.get("AWS_PROFILE") or "default"

    def read() -> dict[str, Any]:
        found = _profile(path, profile)
        keys = {ours: found[theirs] for ours, theirs in _NAMES.items() if theirs in found}
        return {**keys, "expires_at": datetime.now(timezone.utc) + _GOOD_FOR}

    return read


def _profile(path: Path, profile: str) -> Mapping[str, str]:
    """Read one profile of a credentials file.

    Raises:
        ValueError: no such file or profile. The message contains nothing of the file's content.
    """
    parser = configparser.ConfigParser(interpolation=None)  # a % is a character of a secret
    try:
        parser.read_string(path.read_text())
        return parser[profile]
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    except (configparser.Error, KeyError, UnicodeDecodeError):
        raise ValueError(f"{path} has no readable profile {profile}") from None
