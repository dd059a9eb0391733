"""Reading of a zenoh query (key, selector parameters, encoding), and its replies."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from firstfix.errors import InvalidOption

from .. import problems
from ..localize.query_head import QueryHead, split_map_ids
from ..localize.response_format import requested_pose
from ..problems import problem_of
from ..query_workers.answer import PoseFormat
from .callers import ZenohCaller
from .log import PARAMETERS

CONTENT_ENCODING = "content_encoding"
ACCEPT = "accept"
MAP_PARAMETER = "map"
ANY_MAP = "@any"
UNSIGNED = ZenohCaller()


@dataclass(frozen=True)
class ZenohQuery:
    """A query without its payload.

    Attributes:
        key: the key that all replicas share.
        pose: None: the answer is JSON.
    """

    key: str
    head: QueryHead
    pose: PoseFormat | None


def read_query(query: Any, arrived: float) -> ZenohQuery:
    """Reads all of a query except its payload.

    Args:
        arrived: ``time.monotonic`` when it came.

    Raises:
        InvalidOption: a parameter is given twice, or one of the pose format cannot be used.
    """
    pairs = list(query.parameters)
    twice = sorted(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
    if twice:
        raise InvalidOption(f"given more than once: {', '.join(twice)}")
    # Names that begin with an underscore are zenoh's own.
    options = {name: value for name, value in pairs if not name.startswith("_") and name not in PARAMETERS}
    parts = str(query.key_expr).split("/")
    named = parts[1] if len(parts) > 1 else ""
    map_ids = split_map_ids(options.pop(MAP_PARAMETER, "")) if named == ANY_MAP else (named,)
    content_encoding = options.pop(CONTENT_ENCODING, None)
    pose = requested_pose(options.pop(ACCEPT, ""), options)
    media_type = "" if query.encoding is None else str(query.encoding)
    head = QueryHead(map_ids, media_type, content_encoding, options, arrived)
    return ZenohQuery(key_of(named), head, pose)


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
