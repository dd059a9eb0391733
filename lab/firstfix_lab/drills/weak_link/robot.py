"""The robot's end of the link, in a process of its own: asks and keeps time.

python -m firstfix_lab.drills.weak_link.robot '{"client": "Client", "encoding": "compact", ...}'   # see Row
"""

from __future__ import annotations

import asyncio
import json
import math
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix_client import AsyncClient, Client, ZenohClient

XYZ = "application/vnd.firstfix.xyz"
Ask = Callable[[Scan], Localization]


@dataclass(frozen=True)
class Row:
    """The task of one robot.

    Attributes:
        client: of CLIENTS.
        encoding: compact, scan, or raw: three floats a point, as a driver has them.
        queries: one after the other; the scans are taken in turn.
        timeout_s: the deadline of each.
    """

    client: str
    encoding: str
    queries: int
    url: str
    zenoh: str
    map_id: str
    scans: tuple[str, ...]
    timeout_s: float = 10.0


@contextmanager
def over_http(row: Row) -> Iterator[Ask]:
    with Client(row.url, timeout_s=row.timeout_s) as client:
        yield lambda scan: client.localize(scan, **_sent(row))


@contextmanager
def over_http_afresh(row: Row) -> Iterator[Ask]:
    def ask(scan: Scan) -> Localization:
        with Client(row.url, timeout_s=row.timeout_s) as client:
            return client.localize(scan, **_sent(row))

    yield ask


@contextmanager
def over_http_raw(row: Row) -> Iterator[Ask]:
    with Client(row.url, timeout_s=row.timeout_s) as client:
        yield lambda scan: client.localize_body(
            np.asarray(scan.points, "<f4").tobytes(), XYZ, map_id=row.map_id
        )


@contextmanager
def in_an_event_loop(row: Row) -> Iterator[Ask]:
    with asyncio.Runner() as runner:
        client = AsyncClient(row.url, timeout_s=row.timeout_s)
        yield lambda scan: runner.run(client.localize(scan, **_sent(row)))
        runner.run(client.close())


@contextmanager
def over_zenoh(row: Row) -> Iterator[Ask]:
    with ZenohClient(row.zenoh, timeout_s=row.timeout_s) as client:
        yield lambda scan: client.localize(scan, **_sent(row))


CLIENTS = {
    "Client": over_http,
    "Client, a new connection each": over_http_afresh,
    "AsyncClient": in_an_event_loop,
    "ZenohClient": over_zenoh,
}


def asked(row: Row) -> dict[str, Any]:
    """The queries' figures; what raised is ``lost``, whatever it raised."""
    scans = [read_scan_file(Path(path)) for path in row.scans]
    verdicts: Counter[str] = Counter()
    lost: Counter[str] = Counter()
    took_s: list[float] = []
    client = over_http_raw if row.encoding == "raw" else CLIENTS[row.client]
    with client(row) as ask:
        for number in range(row.queries):
            begun = time.monotonic()
            try:
                verdicts[ask(scans[number % len(scans)]).verdict.value] += 1
            except Exception as error:  # any is a loss: this is what is counted
                lost[repr(error)] += 1
            took_s.append(time.monotonic() - begun)
    in_order = sorted(took_s)
    return {
        "queries": len(took_s),
        "verdicts": dict(verdicts),
        "lost": dict(lost),
        "median_s": round(statistics.median(in_order), 3),
        "p95_s": round(in_order[math.ceil(0.95 * len(in_order)) - 1], 3),
        "slowest_s": round(in_order[-1], 3),
    }


def _sent(row: Row) -> dict[str, Any]:
    return {"map_id": row.map_id, "encoding": row.encoding}


if __name__ == "__main__":
    print(json.dumps(asked(Row(**json.loads(sys.argv[1])))))
