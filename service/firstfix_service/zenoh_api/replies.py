"""Threads that send zenoh replies, each of which may wait for a caller who does not read.

zenoh sends a reply with the congestion control of its query, which the caller chooses; by default a reply
waits for room in the caller's connection, until zenoh gives that connection up (``wait_before_close``, 5 s by
default). So does the end of a query without a reply. A service cannot say otherwise, and zenoh does not say
from which connection a query came. So each reply that waits holds a thread, there are more threads than
queries are admitted, and one caller never has more than half of them.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

from ..limits.limits import Limits


@dataclass(frozen=True)
class _Reply:
    query: Any
    send: Callable[[], None]
    caller: str
    sent: Future[None] = field(default_factory=Future)

    def run(self) -> None:
        try:
            with self.query:  # ends the query
                self.send()
        except BaseException as error:  # the session is closing, or the caller has gone
            self.sent.set_exception(error)
        else:
            self.sent.set_result(None)


class ReplyThreads:
    """Sends replies and ends queries. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._has_work = threading.Condition(self._lock)
        self._waiting: deque[_Reply] = deque()
        self._held: Counter[str] = Counter()  # replies by caller, waiting or being sent
        self._threads = 0
        self._idle = 0
        self._is_closed = False

    def __len__(self) -> int:
        """Number of replies that wait or are being sent."""
        with self._lock:
            return self._held.total()

    @property
    def is_full(self) -> bool:
        """True if no thread is free for one more reply."""
        return len(self) >= Limits.max_replies

    def is_full_for(self, caller: str) -> bool:
        """Whether so many replies of the caller are unsent that it gets no more."""
        with self._lock:
            return self._held[caller] >= Limits.max_replies_per_caller

    def send(self, query: Any, send: Callable[[], None], caller: str = "") -> Future[None]:
        """Send a reply and end its query, in a thread.

        It blocks only where ``Limits.max_waiting_replies`` replies wait for a thread: then the reply is sent
        here.

        Returns:
            Future that is done when zenoh has taken the reply, or with its error.
        """
        reply = _Reply(query, send, caller)
        with self._lock:
            self._held[caller] += 1
            is_queued = len(self._waiting) < Limits.max_waiting_replies
            if is_queued:
                self._waiting.append(reply)
                self._has_work.notify()
                if self._idle < len(self._waiting) and self._threads < Limits.max_replies:
                    self._threads += 1
                    threading.Thread(target=self._work, name="zenoh-reply", daemon=True).start()
        if not is_queued:
            self._run(reply)
        return reply.sent

    def end(self, query: Any) -> None:
        """End a query without a reply. A query that has ended already is left alone."""
        self.send(query, lambda: None)

    def close(self) -> None:
        """End the threads once they have sent what waits."""
        with self._lock:
            self._is_closed = True
            self._has_work.notify_all()

    def _work(self) -> None:
        while True:
            with self._lock:
                self._idle += 1
                self._has_work.wait_for(lambda: self._waiting or self._is_closed)
                self._idle -= 1
                if not self._waiting:
                    return
                reply = self._waiting.popleft()
            self._run(reply)
            del reply

    def _run(self, reply: _Reply) -> None:
        try:
            reply.run()
        finally:
            with self._lock:
                self._held[reply.caller] -= 1
                if not self._held[reply.caller]:
                    del self._held[reply.caller]
