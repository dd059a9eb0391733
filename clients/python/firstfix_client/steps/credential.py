"""The credential that a client sends."""

from __future__ import annotations

import os

from firstfix.errors import InvalidOption

VARIABLE = "FIRSTFIX_API_KEY"


def credential(given: str | None) -> str | None:
    """Returns the given API key or token, else that of the environment, else None.

    Raises:
        InvalidOption: the key is not valid in a header. The message does not contain it.
    """
    found = os.environ.get(VARIABLE) if given is None else given
    if not found:
        return None
    key = found.strip()  # a key read from a file ends with a newline
    if not key.isascii() or not key.isprintable() or " " in key:
        raise InvalidOption("an API key can only have printable ASCII characters, without spaces")
    return key
