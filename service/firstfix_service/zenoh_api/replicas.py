"""The replicas that share the maps, found by their liveliness tokens in zenoh.

    firstfix/@replicas/{replica}   liveliness token of every replica that holds maps (``FIRSTFIX_HOLDERS``)

A router does not announce its peers to each other, because it takes them to be connected; it announces all
of them to its clients. So a replica that connects to a router watches the others in a second session, as a
client.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import structlog
import zenoh

from firstfix.ids import is_name
from firstfix.wire.endpoints import said_by_zenoh

from .threads import connected_with

_log = structlog.get_logger(__name__)
TOKENS = "firstfix/@replicas"
FIRST_LOOK_S = 2.0
RETRY_S = 3.0
# Time without a change before the replicas count. When a router restarts, the replicas vanish and come back
# one after the other. Without this wait, each would load the maps of all the others.
SETTLED_S = 3.0
MAX_REPLICAS = 256  # anybody in the zenoh network may declare tokens


class ZenohReplicas:
    """Watches the tokens in a thread of its own, and declares this replica's token. Thread-safe.

    Args:
        session: for this replica's token.
        changed: called after every change, once it has settled, with the names of all replicas, this one
            included. Its second argument returns whether another change has come since.
        client: config of the session that watches; None: ``session`` watches.
    """

    def __init__(
        self,
        session: Any,
        replica: str,
        changed: Callable[[frozenset[str], Callable[[], bool]], None],
        client: Any | None = None,
        *,
        settled_s: float = SETTLED_S,
    ) -> None:
        self._session = session
        self._own = f"{TOKENS}/{replica}"
        self._changed = changed
        self._client = client
        self._settled_s = settled_s
        self._lock = threading.Lock()
        self._keys = {self._own}
        self._event = threading.Event()
        self._stop = threading.Event()
        self._token: Any = None
        self._watching: Any = None  # session that watches
        self._subscriber: Any = None
        self._known: frozenset[str] | None = None  # names of the last successful call of ``changed``
        self._thread = threading.Thread(target=self._run, name="replica-watch", daemon=True)

    @property
    def names(self) -> frozenset[str]:
        """Names of the replicas with a token, and of this one."""
        with self._lock:
            return frozenset(key.rpartition("/")[2] for key in self._keys)

    def start(self) -> frozenset[str]:
        """Start to watch, and return the names seen so far. Blocks for a few seconds at most.

        If nothing can be reached yet, it tries again later.
        """
        self._watch()
        self._known = names = self.names
        self._thread.start()
        return names

    def join(self) -> None:
        """Declare this replica's token, once. Load its maps before: the others rely on it then."""
        if self._token is None and not self._stop.is_set():
            self._token = self._session.liveliness().declare_token(self._own)
            _log.info("holding maps among replicas", replicas=sorted(self.names))

    def leave(self) -> None:
        """Take the token back for good. Others load this replica's maps while it goes on answering."""
        self._stop.set()
        self._event.set()
        token, self._token = self._token, None
        if token is not None:
            token.undeclare()

    def close(self) -> None:
        """Leave and stops watching. May be called again."""
        self.leave()
        if self._thread.ident is not None:
            self._thread.join()
        watching, self._watching = self._watching, None
        if watching is not None and watching is not self._session:
            watching.close()

    def _watch(self) -> None:
        pattern = f"{TOKENS}/*"
        try:
            watching = self._session if self._client is None else zenoh.open(self._client)
            replies = watching.liveliness().get(pattern, timeout=FIRST_LOOK_S)
            with self._lock:
                for reply in replies:
                    if reply.ok is not None:
                        self._add(str(reply.ok.key_expr))
            # history: also reports changes between the look and now
            self._subscriber = watching.liveliness().declare_subscriber(pattern, self._on_token, history=True)
        except zenoh.ZError as error:
            _log.warning("other replicas are not seen yet", error=said_by_zenoh(error))
            return
        self._watching = watching

    def _on_token(self, sample: Any) -> None:
        key = str(sample.key_expr)
        with self._lock:
            before = len(self._keys)
            if not str(sample.kind).endswith("DELETE"):
                self._add(key)
            elif key != self._own:
                self._keys.discard(key)
            has_changed = len(self._keys) != before
        if has_changed:
            self._event.set()

    def _add(self, key: str) -> None:
        if len(self._keys) < MAX_REPLICAS and is_name(key.rpartition("/")[2]):
            self._keys.add(key)

    def _run(self) -> None:
        while self._watching is None and not self._stop.wait(RETRY_S):
            self._watch()
            self._event.set()
        while not self._stop.is_set():
            self._event.wait()
            self._event.clear()
            if self._stop.wait(self._settled_s) or self._event.is_set():
                continue
            names = self.names
            if not connected_with(self._watching):
                self._event.set()  # this replica is cut off; the others have not gone
            elif names != self._known:
                _log.info("other replicas hold maps", replicas=sorted(names))
                try:
                    self._changed(names, self._event.is_set)
                except Exception:  # a defect must not end the watch: nobody would take over
                    _log.exception("the maps of other replicas were not taken over")
                # After another change the call may have ended early.
                self._known = None if self._event.is_set() else names
