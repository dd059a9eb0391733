"""One of the service's query workers. The service replaces it when it is dead, or takes too long."""

from __future__ import annotations

import signal
from collections.abc import Callable

from .part import Effect
from .processes import command_of, send

_MODULE = "firstfix_service.query_workers.worker"


class QueryWorker:
    """One worker, whichever the service started first.

    Args:
        tree: returns the service and its children.
    """

    name = "query worker"
    # The query that runs in it, and one that is given to it before anybody knows.
    effect = Effect(lost=2)

    def __init__(self, tree: Callable[[], list[int]]) -> None:
        self._tree = tree
        self._frozen: list[int] = []

    def start(self) -> None:
        """The service has started it."""

    def freeze(self) -> None:
        self._frozen = [pid for pid in self._tree() if _MODULE in command_of(pid)][:1]
        if not self._frozen:
            raise RuntimeError("the service has no query worker")
        send(self._frozen, signal.SIGSTOP)

    def thaw(self) -> None:
        send(self._frozen, signal.SIGCONT)

    def kill(self) -> None:
        send(self._frozen, signal.SIGKILL)
