"""Errors of the clients: the service's own errors (``firstfix.errors``), and one when no service answers.

A problem document's ``code`` names the class, so that ``except NotFound`` means the same whether the
engine runs in this process or behind a network.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from firstfix.errors import ClockSkew, FirstfixError, Overloaded, RateLimited, StoreUnavailable, error_class

_MAX_TIME_MS = 1 << 52  # some 140,000 years
TRANSIENT = (Overloaded, RateLimited, StoreUnavailable)  # worth another try


class ServiceUnreachable(ConnectionError):
    """No service answered, after all retries that the timeout allowed.

    It is not a FirstfixError: those come from a service or an engine, and here none answered.
    """


def error_of_problem(body: bytes, status: int | None = None) -> FirstfixError | None:
    """The error for a problem document (RFC 9457), or None if the bytes are not one.

    An unknown code, from a newer service, becomes the base class.

    Args:
        status: HTTP status; 503 without a code means an overloaded proxy on the way.
    """
    try:
        problem = json.loads(body)
    except (ValueError, RecursionError):
        problem = None
    if isinstance(problem, Mapping) and isinstance(problem.get("code"), str):
        kind = error_class(problem["code"])
        if kind is ClockSkew:
            return ClockSkew(_text_of(problem), _time_ms_of(problem))
        return kind(_text_of(problem))
    if status == 503:
        return Overloaded("the service, or a proxy in front of it, answered 503")
    return None


def _time_ms_of(problem: Mapping[str, Any]) -> int:
    time_ms = problem.get("time_ms")
    return time_ms if isinstance(time_ms, int) and 0 <= time_ms < _MAX_TIME_MS else 0


def _text_of(problem: Mapping[str, Any]) -> str:
    return str(problem.get("detail") or problem.get("title") or problem["code"])
