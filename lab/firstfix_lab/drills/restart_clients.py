"""kill -9 of the service under its clients' queries, and its restart: how many queries are lost.

    firstfix-lab restart_clients --store DIR --map ID --scan FILE [--queries 200] [--restarts 2]

For each of Client, AsyncClient and ZenohClient, as they are by default: four robots ask without a pause while
the only replica is killed and started again. A query that raises is lost, whatever it raises.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import signal
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from firstfix.answer.localization import Localization
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix_client import AsyncClient, Client, ZenohClient
from tests.claimed import free_port

from ..common.programs import Replica

ROBOTS = 4
Ask = Callable[[Scan, str], Localization]


@contextmanager
def over_http(replica: Replica, timeout_s: float) -> Iterator[Ask]:
    with Client(replica.url, timeout_s=timeout_s) as client:
        yield lambda scan, map_id: client.localize(scan, map_id=map_id)


@contextmanager
def in_an_event_loop(replica: Replica, timeout_s: float) -> Iterator[Ask]:
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    def done(call: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(call, loop).result()

    client = AsyncClient(replica.url, timeout_s=timeout_s)
    try:
        yield lambda scan, map_id: done(client.localize(scan, map_id=map_id))
    finally:
        done(client.close())
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


@contextmanager
def over_zenoh(replica: Replica, timeout_s: float) -> Iterator[Ask]:
    with ZenohClient(replica.endpoint, timeout_s=timeout_s) as client:
        yield lambda scan, map_id: client.localize(scan, map_id=map_id)


CLIENTS: dict[str, Callable[[Replica, float], AbstractContextManager[Ask]]] = {
    "Client": over_http,
    "AsyncClient": in_an_event_loop,
    "ZenohClient": over_zenoh,
}


def restart_under_queries(
    replica: Replica,
    name: str,
    scan: Scan,
    map_id: str,
    *,
    queries: int = 200,
    restarts: int = 2,
    timeout_s: float = 30.0,
) -> dict[str, Any]:
    """The outcomes of the queries of one kind of client; ``lost`` must be empty.

    Args:
        replica: a running one; it is killed when the queries have come so far, and started again.
        name: of CLIENTS.
        timeout_s: the deadline of every query; a restart takes some seconds of it.
    """
    numbers = itertools.count()
    kills = [queries * (one + 1) // (restarts + 1) for one in range(restarts)]
    lost: Counter[str] = Counter()
    took_s: list[float] = []
    begun = threading.Semaphore(0)

    def robot(ask: Ask) -> None:
        while next(numbers) < queries:
            begun.release()
            start = time.monotonic()
            try:
                ask(scan, map_id)
            except Exception as error:  # any is a loss: this is what is counted
                lost[repr(error)] += 1
            took_s.append(time.monotonic() - start)

    down_s = []
    with CLIENTS[name](replica, timeout_s) as ask, ThreadPoolExecutor(ROBOTS) as pool:
        robots = [pool.submit(robot, ask) for _ in range(ROBOTS)]
        for past, kill in itertools.pairwise([0, *kills]):
            for _ in range(kill - past):
                begun.acquire()
            replica.end(signal.SIGKILL)
            start = time.monotonic()
            replica.start().wait_until_ready()
            down_s.append(round(time.monotonic() - start, 2))
        for one in robots:
            one.result()
    return {
        "queries": len(took_s),
        "restarts": restarts,
        "down_s": down_s,
        "lost": dict(lost),
        "median_s": round(sorted(took_s)[len(took_s) // 2], 4),
        "slowest_s": round(max(took_s), 2),
    }


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab restart_clients",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--store", required=True, type=Path)
    parser.add_argument("--map", required=True)
    parser.add_argument("--scan", required=True, type=Path)
    parser.add_argument("--queries", type=int, default=200)
    parser.add_argument("--restarts", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=30.0)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args(arguments)
    scan = read_scan_file(given.scan)
    figures = {}
    for name in CLIENTS:
        with tempfile.TemporaryDirectory() as folder:
            replica = replica_of(Path(folder), str(given.store.resolve()))
            replica.start().wait_until_ready()
            try:
                figures[name] = restart_under_queries(
                    replica,
                    name,
                    scan,
                    given.map,
                    queries=given.queries,
                    restarts=given.restarts,
                    timeout_s=given.timeout,
                )
            finally:
                replica.end()
        print(name, json.dumps(figures[name]))
    if given.json is not None:
        given.json.write_text(json.dumps(figures, indent=1) + "\n")
    return int(any(found["lost"] for found in figures.values()))


def replica_of(directory: Path, store: str, command: list[str] | None = None) -> Replica:
    """A replica that listens for robots on both transports, always at the same ports."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings = {"store": store, "run_builds": False, "zenoh": True, "zenoh_listen": [endpoint]}
    return Replica(directory, settings, command)
