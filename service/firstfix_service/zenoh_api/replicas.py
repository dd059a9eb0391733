"""Which replicas share the maps, by their liveliness tokens in zenoh.

    firstfix/@replicas/{replica}   liveliness token of every replica that holds maps (``FIRSTFIX_HOLDERS``)

A router does not tell its peers of each other (it takes them to be connected), only its clients of all. So
where a replica connects somewhere it watches the others by a session of its own, as a client.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import structlog
import zenoh

_log = structlog.get_logger(__name__)
TOKENS = "firstfix/@replicas"
FIRST_LOOK_S = 2.0
RETRY_S = 3.0
# Without a change until what is seen is believed: when a router restarts the replicas vanish and come back
# one after the other, and each would load the maps of all meanwhile.
SETTLED_S = 3.0


class ZenohReplicas:
    """Follows the tokens in a thread of its own, and shows one. Thread-safe.

    Args:
        session: in which its token is shown.
        changed: called with the replicas' names, this one among them, after every change, once it has
            settled. The second argument says whether another change has come by now.
        client: configuration of a session to watch by; None: by ``session``.
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
        self._watching: Any = None  # session that it watches by
        self._subscriber: Any = None
        self._told: frozenset[str] | None = None  # what was told last, and seen to
        self._thread = threading.Thread(target=self._run, name="replica-watch", daemon=True)

    @property
    def names(self) -> frozenset[str]:
        """Replicas that show a token, and this one."""
        with self._lock:
            return frozenset(key.rpartition("/")[2] for key in self._keys)

    def start(self) -> frozenset[str]:
        """Follows the tokens from now on, or as soon as there is somebody to connect with; returns who is
        seen already. Blocks for a few seconds at most."""
        self._watch()
        self._told = names = self.names
        self._thread.start()
        return names

    def join(self) -> None:
        """Shows this replica's token, once: others leave to it what it holds, so that should be loaded."""
        if self._token is None and not self._stop.is_set():
            self._token = self._session.liveliness().declare_token(self._own)
            _log.info("holding maps among replicas", replicas=sorted(self.names))

    def leave(self) -> None:
        """Takes the token back, for good: others load what it holds, while it goes on answering."""
        self._stop.set()
        self._event.set()
        token, self._token = self._token, None
        if token is not None:
            token.undeclare()

    def close(self) -> None:
        """Leaves, and looks no more. May be called again."""
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
                self._keys |= {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
            # history: who came or went between the look and now is told as well
            self._subscriber = watching.liveliness().declare_subscriber(pattern, self._on_token, history=True)
        except zenoh.ZError as error:
            _log.warning("other replicas are not seen yet", error=str(error))
            return
        self._watching = watching

    def _on_token(self, sample: Any) -> None:
        key = str(sample.key_expr)
        with self._lock:
            before = len(self._keys)
            if not str(sample.kind).endswith("DELETE"):
                self._keys.add(key)
            elif key != self._own:
                self._keys.discard(key)
            has_changed = len(self._keys) != before
        if has_changed:
            self._event.set()

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
            if not self._watching.info.transports():
                self._event.set()  # it is this one that is cut off: the others have not gone
            elif names != self._told:
                _log.info("other replicas hold maps", replicas=sorted(names))
                try:
                    self._changed(names, self._event.is_set)
                except Exception:  # the watch must outlive a defect: else nobody takes over
                    _log.exception("what other replicas held was not taken over")
                self._told = None if self._event.is_set() else names  # it may have ended early
