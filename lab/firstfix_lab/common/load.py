"""Clients that ask one query after the other, each on a connection of its own."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx
import numpy as np


@dataclass(frozen=True)
class Body:
    """A query as it goes over the wire."""

    media_type: str
    content: bytes


Ask = Callable[[Body], str]  # "ok", or what went wrong


@dataclass
class Asked:
    """Answers that all clients of a crowd got.

    Attributes:
        seconds: of each query that was answered.
        outcomes: how often what.
        elapsed_s: of the whole.
    """

    seconds: list[float] = field(default_factory=list)
    outcomes: Counter[str] = field(default_factory=Counter)
    elapsed_s: float = 0.0

    def figures(self) -> dict[str, Any]:
        found: dict[str, Any] = {"queries_a_second": round(len(self.seconds) / self.elapsed_s, 1)}
        if self.seconds:
            p50, p95, p99 = (float(s) * 1e3 for s in np.percentile(self.seconds, [50, 95, 99]))
            found |= {"p50_ms": round(p50, 1), "p95_ms": round(p95, 1), "p99_ms": round(p99, 1)}
        return {**found, "outcomes": dict(self.outcomes)}


def ask_over_http(
    url: str, map_id: str, timeout_s: float = 30.0, api_key: str = "", keep_alive: bool = True
) -> Iterator[Ask]:
    """Ask over a connection of its own, or over a new one each time."""
    headers = {"Authorization": f"Bearer {api_key}"} if api_key else {}
    limits = httpx.Limits(max_keepalive_connections=1 if keep_alive else 0)
    with httpx.Client(base_url=url, timeout=timeout_s, headers=headers, limits=limits) as http:

        def ask(body: Body) -> str:
            try:
                answer = http.post(
                    "/localize",
                    params={"map": map_id},
                    content=body.content,
                    headers={"Content-Type": body.media_type},
                )
            except httpx.TransportError as error:
                return type(error).__name__
            return "ok" if answer.is_success else str(answer.status_code)

        yield ask


def ask_over_zenoh(session: Any, map_id: str, timeout_s: float = 30.0) -> Iterator[Ask]:
    import zenoh

    selector = zenoh.Selector(f"firstfix/{map_id}/localize")

    def ask(body: Body) -> str:
        replies = session.get(selector, payload=body.content, encoding=body.media_type, timeout=timeout_s)
        for reply in replies:
            return "ok" if reply.ok is not None else "error"
        return "nothing"

    yield ask


class Crowd:
    """Clients that ask one query after the other until the block ends.

    Args:
        connect: opens the connection of one client.
        pause_s: of a client between two queries.
    """

    def __init__(
        self, connect: Callable[[], Iterator[Ask]], bodies: list[Body], clients: int, pause_s: float = 0.0
    ) -> None:
        self._connect = connect
        self._pause_s = pause_s
        self._bodies = bodies
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self.asked = Asked()
        self._threads = [
            threading.Thread(target=self._run, args=(number,), daemon=True) for number in range(clients)
        ]

    def __enter__(self) -> Crowd:
        self._begin = time.perf_counter()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self.asked.elapsed_s = time.perf_counter() - self._begin

    def go_on(self, seconds: float, queries: int = 10) -> None:
        """Wait for the given time, and until the clients have had so many answers meanwhile."""
        before = self._answered()
        time.sleep(seconds)
        while self._answered() < before + queries:
            time.sleep(0.05)

    def _answered(self) -> int:
        with self._lock:
            return sum(self.asked.outcomes.values())

    def _run(self, number: int) -> None:
        with contextmanager(self._connect)() as ask:
            turn = number
            while not self._stop.is_set():
                body = self._bodies[turn % len(self._bodies)]
                turn += 1
                begin = time.perf_counter()
                outcome = ask(body)
                seconds = time.perf_counter() - begin
                with self._lock:
                    self.asked.outcomes[outcome] += 1
                    if outcome == "ok":
                        self.asked.seconds.append(seconds)
                self._stop.wait(self._pause_s)


def asked_for(
    connect: Callable[[], Iterator[Ask]], bodies: list[Body], clients: int, seconds: float
) -> Asked:
    with Crowd(connect, bodies, clients) as crowd:
        time.sleep(seconds)
    return crowd.asked
