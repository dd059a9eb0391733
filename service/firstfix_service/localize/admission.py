"""All checks of a query that need no body, each made once, for both transports."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InvalidOption, NotFound
from firstfix.ids import check_map_id, check_version

from ..auth.principal import Principal
from ..maps.served_maps import ServedMaps
from ..query_workers.body_format import BodyFormat
from .asker import SEVERAL_MAPS, Asker
from .query_gate import QueryPool
from .query_head import QueryHead

MAX_MAPS = 16  # that one query searches


@dataclass(frozen=True)
class Admission:
    """A query that passed all checks of its head. Its body may be read now.

    Attributes:
        head: the query as it came.
        map_ids: maps to search: at least one, each once.
        options: of the query, parsed.
        body_format: how to decode the body.
        deadline: of ``time.monotonic``; None: no deadline.
        asker: takes turns in the pool.
    """

    head: QueryHead
    map_ids: tuple[str, ...]
    options: LocalizeOptions
    body_format: BodyFormat
    deadline: float | None
    asker: Asker


def admit(head: QueryHead, caller: Principal, served: ServedMaps, pool: QueryPool) -> Admission:
    """Checks the head of a query.

    Args:
        caller: has the scope ``localize``, and its rate limit allows the query: the transport checked both.

    Raises:
        Forbidden: a named map is not one of the caller's.
        InvalidOption: an id, an option or the version is malformed, or there are too many maps.
        UnsupportedFormat: unknown media type or content encoding.
        NotFound: no map is served yet.
        Overloaded: the pool has no room for the query.
    """
    for map_id in head.map_ids:
        caller.check_map(check_map_id(map_id))
    options = LocalizeOptions.from_strings(head.options)
    if options.version is not None:
        check_version(options.version)
    body_format = BodyFormat.of(head.media_type, head.content_encoding)
    map_ids = _maps_to_search(head, caller, served)
    asker = Asker(caller.name, map_ids[0] if len(map_ids) == 1 else SEVERAL_MAPS)
    pool.check_room(asker)
    deadline = None if options.deadline_ms is None else head.arrived + options.deadline_ms / 1e3
    return Admission(head, map_ids, options, body_format, deadline, asker)


def _maps_to_search(head: QueryHead, caller: Principal, served: ServedMaps) -> tuple[str, ...]:
    if head.map_ids:
        map_ids = tuple(dict.fromkeys(head.map_ids))
    else:
        map_ids = tuple(map_id for map_id in served.ids if caller.sees(map_id))
    if not map_ids:
        raise NotFound("no map is served yet")
    if len(map_ids) > MAX_MAPS:
        raise InvalidOption(f"one query searches up to {MAX_MAPS} maps, not {len(map_ids)}: name some")
    return map_ids
