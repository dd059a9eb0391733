"""Summary of the settings for the log, without secrets."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from pydantic import SecretBytes, SecretStr

from ..settings import Settings

HIDDEN = "***"
_SECRET_WORDS = ("secret", "password", "token", "credential", "private", "api_key")


def settings_summary(settings: Settings) -> dict[str, Any]:
    """The values by name, ready for JSON.

    Values that are secret by their type or name are hidden, and so are users, passwords and unknown
    parameters in URLs.
    """
    return {
        name: HIDDEN if value is not None and _is_secret(name, value) else _shown(value)
        for name, value in settings
    }


def _is_secret(name: str, value: object) -> bool:
    return isinstance(value, SecretStr | SecretBytes) or any(word in name for word in _SECRET_WORDS)


def _shown(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, str):
        return without_secrets(value) if "://" in value else value
    if isinstance(value, tuple | list | set | frozenset):
        return [_shown(item) for item in value]
    return value if value is None or isinstance(value, bool | int | float) else _shown(str(value))


# Parameters of store URLs that name a place. Any other one could be a credential.
_HARMLESS = {
    "endpoint",
    "region",
    "allow_http",
    "virtual_hosted_style_request",
    "skip_signature",
    "use_emulator",
}


def without_secrets(url: str) -> str:
    """The URL without user and password, and with the values of unknown parameters hidden."""
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]
    query = [
        (name, without_secrets(value) if name in _HARMLESS else HIDDEN)
        for name, value in parse_qsl(parts.query, keep_blank_values=True)
    ]
    return urlunsplit((parts.scheme, host, parts.path, urlencode(query, safe=":/*"), ""))
