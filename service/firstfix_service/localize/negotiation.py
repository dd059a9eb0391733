"""HTTP content negotiation (RFC 9110, Accept)."""

from __future__ import annotations

from collections.abc import Sequence

from firstfix.errors import NotAcceptable


def negotiate(accept: str | None, offered: Sequence[str]) -> str:
    """Returns the offered media type with the highest weight; of equals the first.

    Args:
        accept: value of the Accept header; None or empty: anything is accepted.

    Raises:
        NotAcceptable: the caller accepts none of them.
    """
    if accept is None or not accept.strip():
        return offered[0]
    weights = {name: _weight(accept, name) for name in offered}
    best = max(offered, key=lambda name: weights[name])  # of equals the first
    if weights[best] <= 0:
        raise NotAcceptable(f"the answer can be {' or '.join(offered)}, not {accept[:200]!r}")
    return best


def _weight(accept: str, name: str) -> float:
    """Weight of the most specific media range that covers the name; 0: not accepted."""
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
