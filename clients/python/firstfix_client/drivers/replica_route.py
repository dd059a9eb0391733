"""The order in which the replicas of a zenoh key are asked."""

from __future__ import annotations

import random

from .live_replicas import LiveReplicas

UNPROVED = 2  # that are asked before the shared key, where none is proved
EXPLORED_SHARE = 0.125  # of the queries: an unproved replica is asked first


class ReplicaRoute:
    """Route to the live replicas of a key in random order, with their shared key last."""

    def __init__(self, shared: str, replicas: LiveReplicas | None) -> None:
        self._shared = shared
        self._replicas = replicas

    def order(self) -> list[str]:
        """Returns the replicas' keys in random order, then the shared key."""
        return [*self._live(), self._shared]

    def rival(self, target: str, others: list[str]) -> str | None:
        """Returns another live replica, never the shared key: the same replica might get the query."""
        return others[0] if len(others) > 1 else None

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """Returns the shared key: zenoh may not report a query lost when the only replica restarts."""
        return self._shared

    def answered(self, target: str) -> None:
        """Does nothing: the next query goes to another replica, so the load is spread."""

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
        """Returns proved replicas, now and then with an unproved one before them; the shared key last."""
        live = self._live()
        proved = [key for key in live if self._known.is_proved(key)]
        unproved = [key for key in live if key not in proved]
        if not proved:
            return [*unproved[:UNPROVED], self._shared]
        explored = unproved[:1] if random.random() < EXPLORED_SHARE else []
        return [*explored, *proved, self._shared]

    def rival(self, target: str, others: list[str]) -> str | None:
        """Returns another proved replica; for an unproved one the shared key, if there is no proved one."""
        proved = [key for key in others if self._known.is_proved(key)]
        if proved:
            return proved[0]
        return None if target == self._shared or self._known.is_proved(target) else self._shared
