"""The served maps as zenoh keys.

    firstfix/maps                  queryable: every map, its active version and the version that answers here
    firstfix/{map_id}/version      queryable, and published on every change: the versions of one map
    firstfix/@replicas/{replica}   queryable: this replica, the maps that it serves and holds, its load

Replies come from memory, as of the last poll of the store. Publications are notices and may be lost. Every
replica publishes when it has followed a change; ``seq`` orders the publications of one map.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import structlog
import zenoh

import firstfix
from firstfix.catalog.catalog import Catalog
from firstfix.errors import NotFound

from ..maps.map_cache import MapCache
from .query import reply_error
from .replies import ReplyThreads

_log = structlog.get_logger(__name__)
JSON = "application/json"
MAPS = "firstfix/maps"


@dataclass(frozen=True)
class MapVersions:
    """Versions of one map, as this replica knows them.

    Attributes:
        version: the active version; None: the map has none any more.
        previous: the version that was active before, for a rollback.
        serving_version: the version from which this replica answers; None: none is loaded yet. It differs
            from ``version`` if that one was refused.
        seq: number of the last entry in the map's log: the higher one is newer.
    """

    map_id: str
    version: str | None
    previous: str | None
    serving_version: str | None
    seq: int

    @property
    def key(self) -> str:
        """The key of this map's versions."""
        return f"firstfix/{self.map_id}/version"

    def to_json(self, replica: str) -> bytes:
        """The payload that this replica sends."""
        return _json({**asdict(self), "replica": replica})


class ZenohCatalog:
    """Answers the catalog keys from its first update on. Thread-safe, except ``update``.

    Args:
        load: returns the number of queries that wait or run here, and its limit.

    Attributes:
        replies: sends the replies, beside those to scans: who does not read lists stops no answer to a scan.
    """

    def __init__(
        self,
        session: Any,
        replica: str,
        maps: MapCache,
        catalog: Catalog,
        load: Callable[[], dict[str, int]],
    ) -> None:
        self._session = session
        self.replies = ReplyThreads()
        self._replica = replica
        self._maps = maps
        self._catalog = catalog
        self._load = load
        self._known: dict[str, MapVersions] = {}  # replaced, never changed
        self._queryables: list[Any] = []

    def update(self, touched: Iterable[str], before_each: Callable[[], None]) -> None:
        """Publish changes of these maps since the last update. Call it after every poll.

        The first update publishes nothing, because the start of a replica changes no map.

        Args:
            before_each: called before each call of zenoh.
        """
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
            before_each()
            self._session.put(versions.key, versions.to_json(self._replica), encoding=JSON)

    def close(self) -> None:
        """Take the keys back."""
        for queryable in self._queryables:
            queryable.undeclare()
        self.replies.close()

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
        reply = partial(query.reply, MAPS, _json({"maps": maps}), encoding=JSON)
        self.replies.send(query, reply)

    def _answer_versions(self, query: Any) -> None:
        found = self._asked_for(query.key_expr)

        def reply() -> None:
            for one in found:
                query.reply(one.key, one.to_json(self._replica), encoding=JSON)
            if not found:
                reply_error(query, NotFound(f"no map is served on {query.key_expr}"))

        self.replies.send(query, reply)

    def _asked_for(self, key: Any) -> list[MapVersions]:
        known, parts = self._known, str(key).split("/")
        if len(parts) == 3 and parts[1] in known:  # one map: no need to compare all
            return [known[parts[1]]]
        return [one for _, one in sorted(known.items()) if key.intersects(zenoh.KeyExpr(one.key))]

    def _answer_replica(self, query: Any) -> None:
        described: dict[str, Any] = {
            "replica": self._replica,
            "service_version": firstfix.__version__,
            "maps": {map_id: one.serving_version for map_id, one in sorted(self._known.items())},
            "load": self._load(),
        }
        if self._maps.placement is not None:
            described["holding"] = self._maps.placement.summary(self._maps.held_loaded)
        key = f"firstfix/@replicas/{self._replica}"
        self.replies.send(query, partial(query.reply, key, _json(described), encoding=JSON))


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()
