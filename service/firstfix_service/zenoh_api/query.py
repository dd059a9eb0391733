"""One zenoh query: its scope and log line, its key, selector parameters and encoding, and its replies.

zenoh has no headers: three selector parameters replace X-Request-Id, traceparent and X-Robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import Any

import structlog

from .. import problems
from ..auth.principal import Principal
from ..problems import problem_of
from ..query_workers.answer_form import AnswerForm
from ..query_workers.query import MAP_PARAMETER, AsGiven, Query, remembered, single_values, split_map_ids
from ..telemetry.request_scope import Requests, note_robot
from .callers import ZenohCaller

_log = structlog.get_logger(__name__)
TRANSPORT = "zenoh"
REQUEST_ID, TRACEPARENT, ROBOT = "request_id", "traceparent", "robot"
PARAMETERS = (REQUEST_ID, TRACEPARENT, ROBOT)  # of every query, beside the options
_METHOD = "GET"  # zenoh's word for a query
CONTENT_ENCODING = "content_encoding"
ACCEPT = "accept"
ANY_MAP = "@any"
UNSIGNED = ZenohCaller()


@contextmanager
def logged_query(requests: Requests, query: Any, arrived: float) -> Iterator[None]:
    """Open the scope of one query, and log the query when it ends.

    Args:
        arrived: ``time.monotonic`` when it came.
    """
    given = dict(query.parameters)
    key = str(query.key_expr)
    with requests.scope(
        TRANSPORT,
        "zenoh localize",
        request_id=given.get(REQUEST_ID, ""),
        traceparent=given.get(TRACEPARENT),
        started=arrived,
    ) as scope:
        try:
            yield
        finally:
            _log.info("request", method=_METHOD, path=key, **scope.line(scope.seconds))
            if scope.span is not None:
                scope.span.set_attribute("zenoh.key", key)


def read_query(
    query: Any, caller: Principal, served: Callable[[], Iterable[str]], arrived: float
) -> tuple[str, Query]:
    """Read all of a query except its payload.

    Returns:
        The key that all replicas share, and the query.

    Raises:
        FirstfixError: as ``Query.read``, and a parameter is given twice, or the robot's name is malformed.
    """
    # Names that begin with an underscore are zenoh's own.
    parameters = single_values(list(query.parameters))
    note_robot(parameters.get(ROBOT))
    options = [one for one in parameters.items() if not one[0].startswith("_") and one[0] not in PARAMETERS]
    parts = str(query.key_expr).split("/")
    named = parts[1] if len(parts) > 1 else ""
    media_type = "" if query.encoding is None else str(query.encoding)
    given = _as_given(named, media_type, *chain.from_iterable(options))
    return key_of(named), Query.read(given, caller, served, arrived)


@remembered
def _as_given(named: str, media_type: str, *names_and_values: str) -> AsGiven:
    """Parse what a query asks for, by itself.

    Args:
        named: the map in the key.
        names_and_values: of the parameters, in turn.

    Raises:
        InvalidOption: as ``AnswerForm.of``.
    """
    options = dict(zip(names_and_values[::2], names_and_values[1::2], strict=True))
    map_ids = split_map_ids(options.pop(MAP_PARAMETER, "")) if named == ANY_MAP else (named,)
    content_encoding = options.pop(CONTENT_ENCODING, "")
    form = AnswerForm.of(options.pop(ACCEPT, ""), options)
    return AsGiven(map_ids, media_type, content_encoding, options, form)


def key_of(map_id: str) -> str:
    """The key on which a map's queries are asked."""
    return f"firstfix/{map_id}/localize"


def reply_ok(query: Any, caller: ZenohCaller, key: str, content: bytes, media_type: str) -> None:
    """Answer a query, with a signature if the query has one."""
    query.reply(key, content, encoding=caller.encoding(True, media_type, content))


def reply_error(query: Any, error: BaseException, caller: ZenohCaller = UNSIGNED) -> None:
    """Answer a query with the problem document of an error, with a signature if the query has one."""
    content = problem_of(error).body
    query.reply_err(content, encoding=caller.encoding(False, problems.MEDIA_TYPE, content))
