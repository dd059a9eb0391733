"""Which form of an answer a caller takes (RFC 9110, Accept)."""

from __future__ import annotations

from collections.abc import Sequence

from firstfix.errors import NotAcceptable


def negotiated(accept: str | None, offered: Sequence[str]) -> str:
    """The media type of the answer: what the caller weighs most, of equals the first that is offered.

    Raises:
        NotAcceptable: the caller takes none of them.
    """
    if accept is None or not accept.strip():
        return offered[0]
    weights = {name: _weight(accept, name) for name in offered}
    best = max(offered, key=lambda name: weights[name])  # of equals the first
    if weights[best] <= 0:
        raise NotAcceptable(f"the answer is {' or '.join(offered)}, not {accept[:200]!r}")
    return best


def _weight(accept: str, name: str) -> float:
    """What the most specific range that the name falls into is worth; 0: not wanted."""
    ranges = {f"{name.split('/', 1)[0]}/*": 1, "*/*": 0, name: 2}
    found = (-1, 0.0)
    for item in accept.split(","):
        wanted, *parameters = (part.strip().lower() for part in item.split(";"))
        if wanted in ranges:
            found = max(found, (ranges[wanted], _quality(parameters)))
    return found[1]


def _quality(parameters: Sequence[str]) -> float:
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                return min(max(float(value), 0.0), 1.0)
            except ValueError:
                return 0.0
    return 1.0
