"""Live replicas, from their zenoh liveliness tokens, and the order in which they are asked."""

from __future__ import annotations

import random
import threading
from typing import Any

from firstfix.ids import is_name

FIRST_LOOK_S = 1.0
MAX_REPLICAS = 1000  # of one key: anybody may declare tokens


class LiveReplicas:
    """Live replicas for each key that was asked for, updated by their tokens. Thread-safe.

    A token proves nothing. A signed reply does: ``proved`` remembers who gave one.
    """

    def __init__(self, session: Any) -> None:
        self._session = session
        self._keys: dict[str, set[str]] = {}
        self._proved: set[str] = set()
        self._subscribers: list[Any] = []
        self._watching = threading.Lock()  # held during calls into zenoh
        self._changing = threading.Lock()  # taken by zenoh's callbacks, so never held over such calls

    def of(self, shared: str) -> list[str]:
        """The keys ``{shared}/{replica}`` of live replicas, sorted."""
        with self._watching:
            if shared not in self._keys:
                self._keys[shared] = self._watch(f"{shared}/*")
        with self._changing:
            return sorted(self._keys[shared])

    def prove(self, key: str) -> None:
        """Record that the replica with this key has the secret that replies are signed with."""
        with self._changing:
            if any(key in keys for keys in self._keys.values()):
                self._proved.add(key)

    def is_proved(self, key: str) -> bool:
        """Whether the replica has given a signed reply since it is live."""
        return key in self._proved

    def _watch(self, pattern: str) -> set[str]:
        keys: set[str] = set()

        def add(key: str) -> None:
            if len(keys) < MAX_REPLICAS and is_name(key.rpartition("/")[2]):
                keys.add(key)

        def changed(sample: Any) -> None:
            key = str(sample.key_expr)
            with self._changing:
                if str(sample.kind).endswith("DELETE"):
                    keys.discard(key)
                    self._proved.discard(key)
                else:
                    add(key)

        for reply in self._session.liveliness().get(pattern, timeout=FIRST_LOOK_S):
            if reply.ok is not None:
                add(str(reply.ok.key_expr))
        # history: also reports replicas that came or went since the first look
        subscriber = self._session.liveliness().declare_subscriber(pattern, changed, history=True)
        self._subscribers.append(subscriber)
        return keys


UNPROVED = 2  # that are asked before the shared key, where none is proved
EXPLORED_SHARE = 0.125  # of the queries: an unproved replica is asked first


class ReplicaRoute:
    """Route to the live replicas of a key in random order, with their shared key last."""

    def __init__(self, shared: str, replicas: LiveReplicas | None) -> None:
        self._shared = shared
        self._replicas = replicas

    def order(self) -> list[str]:
        """The replicas' keys in random order, then the shared key."""
        return [*self._live(), self._shared]

    def rival(self, target: str, others: list[str]) -> str | None:
        """Another live replica, never the shared key: the same replica might get the query."""
        return others[0] if len(others) > 1 else None

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """The shared key: zenoh may not report a query lost when the only replica restarts."""
        return self._shared

    def answered(self, target: str) -> None:
        """Do nothing: the next query goes to another replica, so the load is spread."""

    def _live(self) -> list[str]:
        live = [] if self._replicas is None else self._replicas.of(self._shared)
        random.shuffle(live)
        return live


class SignedRoute(ReplicaRoute):
    """Route for signed queries: replicas that have proved themselves are preferred to mere tokens.

    A stranger may declare any number of tokens, and leave queries on them open. So few of them are asked
    before the shared key, whose queries every replica gets.
    """

    def __init__(self, shared: str, replicas: LiveReplicas) -> None:
        super().__init__(shared, replicas)
        self._known = replicas

    def order(self) -> list[str]:
        """Proved replicas, now and then with an unproved one before them; the shared key last."""
        live = self._live()
        proved = [key for key in live if self._known.is_proved(key)]
        unproved = [key for key in live if key not in proved]
        if not proved:
            return [*unproved[:UNPROVED], self._shared]
        explored = unproved[:1] if random.random() < EXPLORED_SHARE else []
        return [*explored, *proved, self._shared]

    def rival(self, target: str, others: list[str]) -> str | None:
        """Another proved replica; for an unproved one the shared key, if there is no proved one."""
        proved = [key for key in others if self._known.is_proved(key)]
        if proved:
            return proved[0]
        return None if target == self._shared or self._known.is_proved(target) else self._shared
