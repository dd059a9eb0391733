"""Reading of a zenoh query (key, selector parameters, encoding), and its replies."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from .. import problems
from ..auth.principal import Principal
from ..problems import problem_of
from ..query_workers.query import AnswerForm, AsGiven, Query, single_values, split_map_ids
from .callers import ZenohCaller
from .log import PARAMETERS

CONTENT_ENCODING = "content_encoding"
ACCEPT = "accept"
MAP_PARAMETER = "map"
ANY_MAP = "@any"
UNSIGNED = ZenohCaller()


def read_query(
    query: Any, caller: Principal, served: Callable[[], Iterable[str]], arrived: float
) -> tuple[str, Query]:
    """Reads all of a query except its payload.

    Returns:
        The key that all replicas share, and the query.

    Raises:
        FirstfixError: as ``Query.read``, and a parameter is given twice.
    """
    # Names that begin with an underscore are zenoh's own.
    parameters = single_values(list(query.parameters))
    options = {k: v for k, v in parameters.items() if not k.startswith("_") and k not in PARAMETERS}
    parts = str(query.key_expr).split("/")
    named = parts[1] if len(parts) > 1 else ""
    map_ids = split_map_ids(options.pop(MAP_PARAMETER, "")) if named == ANY_MAP else (named,)
    content_encoding = options.pop(CONTENT_ENCODING, "")
    form = AnswerForm.of(options.pop(ACCEPT, ""), options)
    media_type = "" if query.encoding is None else str(query.encoding)
    given = AsGiven(map_ids, media_type, content_encoding, options)
    return key_of(named), Query.read(given, form, caller, served, arrived)


def key_of(map_id: str) -> str:
    """Returns the key on which a map's queries are asked."""
    return f"firstfix/{map_id}/localize"


def reply_ok(query: Any, caller: ZenohCaller, key: str, content: bytes, media_type: str) -> None:
    """Answers a query, with a signature if the query has one."""
    query.reply(key, content, encoding=caller.encoding(True, media_type, content))


def reply_error(query: Any, error: BaseException, caller: ZenohCaller = UNSIGNED) -> None:
    """Answers a query with the problem document of an error, with a signature if the query has one."""
    content = problem_of(error).body
    query.reply_err(content, encoding=caller.encoding(False, problems.MEDIA_TYPE, content))
