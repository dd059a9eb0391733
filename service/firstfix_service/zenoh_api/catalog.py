"""What is served, as zenoh keys.

    firstfix/maps                  queryable: every map, its active version and the one that answers here
    firstfix/{map_id}/version      queryable, and published on every change: one map's versions
    firstfix/@replicas/{replica}   queryable: this replica, what it serves and holds, how busy it is

Answered from memory as of the last poll: nobody waits for the store. The publications are notices and may
be lost; every replica sends its own, when it has followed; ``seq`` orders a map's.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import structlog
import zenoh

import firstfix
from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError, NotFound

from .. import problems
from ..maps.map_cache import MapCache
from ..problems import problem_of

_log = structlog.get_logger(__name__)
JSON = "application/json"
MAPS = "firstfix/maps"


@dataclass(frozen=True)
class MapVersions:
    """What a replica knows of one map.

    Attributes:
        version: the active one; None: the map has none any more.
        previous: what was active before and could be again.
        serving_version: what this replica answers with; None when it has loaded none yet. Another one than
            ``version`` when that was refused.
        seq: of the last entry in the map's log: of two of these of one map the higher is the newer.
    """

    map_id: str
    version: str | None
    previous: str | None
    serving_version: str | None
    seq: int

    @property
    def key(self) -> str:
        return f"firstfix/{self.map_id}/version"

    def to_json(self, replica: str) -> bytes:
        return _json({**asdict(self), "replica": replica})


class ZenohCatalog:
    """Declares its keys in a session with the first update. Thread-safe but for ``update``.

    Args:
        load: the queries that wait or run here, and how many there may be.
    """

    def __init__(
        self, session: Any, replica: str, maps: MapCache, catalog: Catalog, load: Callable[[], dict[str, int]]
    ) -> None:
        self._session = session
        self._replica = replica
        self._maps = maps
        self._catalog = catalog
        self._load = load
        self._known: dict[str, MapVersions] = {}  # replaced, never changed
        self._queryables: list[Any] = []

    def update(self, touched: Iterable[str]) -> None:
        """To be called after every poll: tells what has changed of these maps since the last one. The first
        tells nothing: a replica that starts changes nothing."""
        known, changed = dict(self._known), []
        for map_id in touched:
            before, now = known.pop(map_id, None), self._versions_of(map_id)
            if map_id in self._maps.served:
                known[map_id] = now
            elif before is None:
                continue
            if now != before:
                changed.append(now)
        self._known = known
        if not self._queryables:
            changed = []
            answers = {
                MAPS: self._answer_maps,
                "firstfix/*/version": self._answer_versions,
                f"firstfix/@replicas/{self._replica}": self._answer_replica,
            }
            for key, answer in answers.items():
                self._queryables.append(self._session.declare_queryable(key, answer, complete=True))
        for versions in changed:
            self._session.put(versions.key, versions.to_json(self._replica), encoding=JSON)

    def close(self) -> None:
        for queryable in self._queryables:
            queryable.undeclare()

    def _versions_of(self, map_id: str) -> MapVersions:
        state = self._catalog.known_state(map_id)
        previous = state.activated[1] if len(state.activated) > 1 else None
        serving = self._maps.served.version(map_id)
        return MapVersions(map_id, state.active, previous, serving, state.last_seq)

    def _answer_maps(self, query: Any) -> None:
        maps = [
            {"map_id": one.map_id, "active_version": one.version, "serving_version": one.serving_version}
            for _, one in sorted(self._known.items())
        ]
        with query:
            query.reply(MAPS, _json({"maps": maps}), encoding=JSON)

    def _answer_versions(self, query: Any) -> None:
        with query:
            found = self._asked_for(query.key_expr)
            for one in found:
                query.reply(one.key, one.to_json(self._replica), encoding=JSON)
            if not found:
                _reply_error(query, NotFound(f"no map is served on {query.key_expr}"))

    def _asked_for(self, key: Any) -> list[MapVersions]:
        known, parts = self._known, str(key).split("/")
        if len(parts) == 3 and parts[1] in known:  # one map: no need to look at all
            return [known[parts[1]]]
        return [one for _, one in sorted(known.items()) if key.intersects(zenoh.KeyExpr(one.key))]

    def _answer_replica(self, query: Any) -> None:
        described: dict[str, Any] = {
            "replica": self._replica,
            "service_version": firstfix.__version__,
            "maps": {map_id: one.serving_version for map_id, one in sorted(self._known.items())},
            "load": self._load(),
        }
        if self._maps.holding is not None:
            described["holding"] = self._maps.holding.described(self._maps.held_loaded)
        with query:
            query.reply(f"firstfix/@replicas/{self._replica}", _json(described), encoding=JSON)


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()


def _reply_error(query: Any, error: FirstfixError) -> None:
    query.reply_err(problem_of(error).body, encoding=problems.MEDIA_TYPE)
