"""Errors of the clients: the service's own errors (``firstfix.errors``), and one when no service answers.

A problem document's ``code`` names the class, so that ``except NotFound`` means the same whether the
engine runs in this process or behind a network.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from firstfix.errors import FirstfixError, Overloaded, RateLimited, StoreUnavailable, error_class

TRANSIENT = (Overloaded, RateLimited, StoreUnavailable)  # worth another try


class ServiceUnreachable(ConnectionError):
    """No service answered, after all retries that the timeout allowed.

    It is not a FirstfixError: those come from a service or an engine, and here none answered.
    """


def error_of_problem(body: bytes, status: int | None = None) -> FirstfixError | None:
    """Returns the error for a problem document (RFC 9457), or None if the bytes are not one.

    An unknown code, from a newer service, becomes the base class.

    Args:
        status: HTTP status; 503 without a code means an overloaded proxy on the way.
    """
    try:
        problem = json.loads(body)
    except ValueError:
        problem = None
    if isinstance(problem, Mapping) and isinstance(problem.get("code"), str):
        return error_class(problem["code"])(_text_of(problem))
    if status == 503:
        return Overloaded("the service, or a proxy in front of it, answered 503")
    return None


def _text_of(problem: Mapping[str, Any]) -> str:
    return str(problem.get("detail") or problem.get("title") or problem["code"])
