"""Sends damaged bodies to a service, which must answer each in time and within its memory.

    firstfix-lab fuzz_bodies [--store DIR] [--map ID] [--count 1000] [--seed 0]

Starts a service over a store that has a map (``make demo`` leaves one), sends it damaged bodies of every
encoding over HTTP and zenoh, and then those that ask for trouble. Ends with an error when one is answered 5xx
(but 503, full, and 504, too late), later than its deadline, or when the service's memory has grown too much.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from firstfix_cli.local_service import LocalService, local_service
from tests.hostile_bodies import Body, crafted_bodies, damaged, good_bodies

from ..common.memory import PeakMemory, memory_of_children

DEADLINE_S = 10.0
GRACE_S = 20.0  # for the way there and back on a busy machine
MAX_GROWTH_BYTES = 200_000_000
_NO_DEFECT = {503, 504}

Ask = Callable[[Body], int]


@dataclass
class Outcome:
    """Answers to all bodies.

    Attributes:
        statuses: how often each was the answer.
        wrong: bodies that were answered as they must not be, and how.
        slowest_s: the longest wait for an answer.
    """

    statuses: Counter[int] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    slowest_s: float = 0.0

    def add(self, body: Body, status: int, seconds: float) -> None:
        self.statuses[status] += 1
        self.slowest_s = max(self.slowest_s, seconds)
        right = status in body.statuses if body.statuses else status < 500 or status in _NO_DEFECT
        if not right:
            self.wrong.append(f"{body.name}: {status}")
        if seconds > DEADLINE_S + GRACE_S:
            self.wrong.append(f"{body.name}: {seconds:.1f} s")


def fuzz(ask: Ask, count: int, seed: int = 0) -> Outcome:
    """Send the good bodies, ``count`` damaged ones of each, and the crafted ones, one after the other."""
    outcome = Outcome()
    for body in _bodies(count, seed):
        started = time.perf_counter()
        status = ask(body)
        outcome.add(body, status, time.perf_counter() - started)
    return outcome


def _bodies(count: int, seed: int) -> Iterator[Body]:
    good = good_bodies()
    yield from good
    for number, body in enumerate(good):
        rng = np.random.default_rng([seed, number])
        for _ in range(count):
            yield damaged(body, rng)
    yield from crafted_bodies()
    yield from good  # it still answers


def http_asker(http: httpx.Client, map_id: str) -> Ask:
    """Ask over HTTP: the status of the answer."""

    def ask(body: Body) -> int:
        headers = {"Content-Type": body.media_type}
        if body.content_encoding is not None:
            headers["Content-Encoding"] = body.content_encoding
        params = {"map": map_id, "deadline_ms": str(int(DEADLINE_S * 1e3))}
        return http.post("/localize", params=params, content=body.data, headers=headers).status_code

    return ask


def zenoh_asker(session: Any, map_id: str) -> Ask:
    """Ask over zenoh: 200, or the status in the problem document; 500 for no answer."""
    import zenoh

    def ask(body: Body) -> int:
        parameters = {"deadline_ms": str(int(DEADLINE_S * 1e3))}
        if body.content_encoding is not None:
            parameters["content_encoding"] = body.content_encoding
        selector = zenoh.Selector(f"firstfix/{map_id}/localize", parameters)
        timeout_s = DEADLINE_S + GRACE_S
        for reply in session.get(selector, payload=body.data, encoding=body.media_type, timeout=timeout_s):
            if reply.ok is not None:
                return 200
            try:
                return int(json.loads(reply.err.payload.to_bytes())["status"])
            except (ValueError, KeyError):  # zenoh's own word: a timeout
                return 500
        return 500

    return ask


def run(store: Path, map_id: str, count: int, seed: int) -> dict[str, Any]:
    """The figures of both transports, from a service of its own."""
    figures: dict[str, Any] = {"count": count, "seed": seed}
    with tempfile.TemporaryDirectory() as directory, local_service(Path(directory), store) as service:
        for transport in ("http", "zenoh"):
            with _asker(transport, service, map_id) as ask:
                for body in [*good_bodies(), *good_bodies(points=100_000)]:
                    ask(body)  # what is loaded with the first queries is no growth
                baseline = memory_of_children()
                with PeakMemory() as memory:
                    outcome = fuzz(ask, count, seed)
            figures[transport] = {
                "statuses": {str(status): number for status, number in sorted(outcome.statuses.items())},
                "wrong": outcome.wrong,
                "slowest_s": round(outcome.slowest_s, 3),
                "baseline_mb": round(baseline / 1e6, 1),
                "growth_mb": round((memory.peak_bytes - baseline) / 1e6, 1),
            }
    return figures


@contextmanager
def _asker(transport: str, service: LocalService, map_id: str) -> Iterator[Ask]:
    if transport == "http":
        with httpx.Client(base_url=service.url, timeout=DEADLINE_S + GRACE_S + 5) as http:
            yield http_asker(http, map_id)
        return
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([service.zenoh]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield zenoh_asker(session, map_id)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab fuzz_bodies", description="Fuzzes a running service.")
    parser.add_argument("--store", type=Path, default=Path("demo/store"))
    parser.add_argument("--map", default="factory")
    parser.add_argument("--count", type=int, default=1000, help="damaged bodies of each encoding")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    figures = run(chosen.store, chosen.map, chosen.count, chosen.seed)
    print(json.dumps(figures, indent=1))
    bad = any(
        figures[transport]["wrong"] or figures[transport]["growth_mb"] * 1e6 > MAX_GROWTH_BYTES
        for transport in ("http", "zenoh")
    )
    return 1 if bad else 0
