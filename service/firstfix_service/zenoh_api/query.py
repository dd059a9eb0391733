"""A zenoh query as the service reads it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from firstfix.errors import InvalidOption, Unauthorized
from firstfix.ids import check_map_id

from ..localize.response_format import PoseReply
from .log import PARAMETERS

CONTENT_ENCODING = "content_encoding"
ACCEPT = "accept"
MAP_PARAMETER = "map"
ANY_MAP = "@any"
MAX_CREDENTIAL_BYTES = 16 << 10


@dataclass(frozen=True)
class ZenohQuery:
    """A query as it came.

    Attributes:
        key: what the replicas share.
        map_id: as the use case takes it: one, several, or empty for all.
    """

    key: str
    map_id: str
    media_type: str
    content_encoding: str | None
    options: dict[str, str]
    pose: PoseReply | None


def credential_of(query: Any) -> str | None:
    """The API key or token that stands in a query's attachment.

    Raises:
        Unauthorized: the attachment is none.
    """
    attachment = query.attachment
    if attachment is None:
        return None
    if len(attachment) > MAX_CREDENTIAL_BYTES:
        raise Unauthorized(f"an attachment holds a credential of up to {MAX_CREDENTIAL_BYTES} bytes")
    return attachment.to_bytes().decode("ascii", "replace")


def read_query(query: Any) -> ZenohQuery:
    """
    Raises:
        InvalidOption: its key names no single map, a parameter stands twice, or one of the reply's form
            cannot be used.
    """
    pairs = list(query.parameters)
    twice = sorted(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
    if twice:
        raise InvalidOption(f"given more than once: {', '.join(twice)}")
    # Names that begin with an underscore are zenoh's own.
    options = {name: value for name, value in pairs if not name.startswith("_") and name not in PARAMETERS}
    parts = str(query.key_expr).split("/")
    named = parts[1] if len(parts) > 1 else ""
    map_id = options.pop(MAP_PARAMETER, "") if named == ANY_MAP else check_map_id(named)
    content_encoding = options.pop(CONTENT_ENCODING, None)
    pose = PoseReply.wanted(options.pop(ACCEPT, ""), options)
    media_type = "" if query.encoding is None else str(query.encoding)
    return ZenohQuery(key_of(named), map_id, media_type, content_encoding, options, pose)


def key_of(map_id: str) -> str:
    return f"firstfix/{map_id}/localize"
