"""What a client raises: the service's own errors as ``firstfix.errors``, and one for no service at all.

A problem document's ``code`` names the class, so that ``except NotFound`` means the same whether the
engine runs in this process or behind a network.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from firstfix.errors import FirstfixError, Overloaded, RateLimited, StoreUnavailable, all_errors

PASSING = (Overloaded, RateLimited, StoreUnavailable)  # what a service says of a moment: worth asking again
_BY_CODE = {cls.code: cls for cls in all_errors()}


class ServiceUnreachable(ConnectionError):
    """No service answered, after every retry that the timeout allowed.

    Not a FirstfixError: those are what a service or an engine says, and here nobody said anything.
    """


def error_of_problem(body: bytes, status: int | None = None) -> FirstfixError | None:
    """The error that a problem document (RFC 9457) stands for, or None if the bytes are none.

    A code that this client does not know, from a newer service, becomes the base class.

    Args:
        status: of the HTTP answer; 503 without a code is an overloaded proxy on the way.
    """
    try:
        problem = json.loads(body)
    except ValueError:
        problem = None
    if isinstance(problem, Mapping) and isinstance(problem.get("code"), str):
        return _BY_CODE.get(problem["code"], FirstfixError)(_text_of(problem))
    if status == 503:
        return Overloaded("the service, or a proxy before it, answered 503")
    return None


def _text_of(problem: Mapping[str, Any]) -> str:
    return str(problem.get("detail") or problem.get("title") or problem["code"])
