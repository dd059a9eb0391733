"""What a client shows to be let in."""

from __future__ import annotations

import os

from firstfix.errors import InvalidOption

VARIABLE = "FIRSTFIX_API_KEY"


def credential(given: str | None) -> str | None:
    """An API key or token, else that of the environment; None: there is none.

    Raises:
        InvalidOption: it cannot stand in a header. The message does not repeat it.
    """
    found = os.environ.get(VARIABLE) if given is None else given
    if not found:
        return None
    key = found.strip()  # of a file it was read from
    if not key.isascii() or not key.isprintable() or " " in key:
        raise InvalidOption("the API key has characters that none has")
    return key
