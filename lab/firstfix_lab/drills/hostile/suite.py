"""A service under attack: what the queries of another caller see of it.

firstfix-lab hostile [--quick] [--json FILE]
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import ALL_MAPS, Grant
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import CLOUD_POINTS, Manifest
from firstfix.store.store import Store

from ...common.load import Ask, Body, Crowd, ask_over_http
from ...common.programs import Replica, replica
from ...common.small_map import make_small_map, query_of
from .attacks import ATTACKS

MAP = "yard"
PAUSE_S = 0.05  # between two queries of a client: this caller leaves most of the machine alone
CALL_PAUSE_S = 0.2
TIMEOUT_S = 30.0
WARM_UP_QUERIES = 20
MAX_RATIO = 2.0
CLOUD_POINTS_ASKED = 500_000  # of one request, the most that the service gives
POINT_BYTES = 8
CONNECTIONS = "firstfix_http_connections"


def run(quick: bool, attacks: Sequence[str] = tuple(ATTACKS)) -> dict[str, Any]:
    """Over a small map that is built here."""
    with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder:
        version = make_small_map(Path(folder) / "map")
        seconds = 5.0 if quick else 20.0
        figures = under_attack(
            version, query_of(version), Path(folder), seconds=seconds, share=1.0, attacks=attacks
        )
    print(table(figures), flush=True)
    return figures


def under_attack(
    version: Path,
    body: Body,
    directory: Path,
    *,
    seconds: float,
    share: float,
    attacks: Sequence[str] = tuple(ATTACKS),
) -> dict[str, Any]:
    """The figures of every attack, each beside a quiet time just before it.

    Args:
        version: folder of a version's files.
        share: of the connections that each attack has in full.
    """
    store = directory / "store"
    large = _with_large_cloud(version, directory / "large")
    digest = Catalog(Store.open(str(store))).publish(MAP, large, Manifest.for_directory(large))
    keys = ApiKeys(Store.open(str(store)))
    _, ours = keys.create("robot", Grant.parse(["localize"], ALL_MAPS))
    _, theirs = keys.create("attacker", Grant.parse(["build"], ALL_MAPS))
    figures: dict[str, Any] = {
        "machine": {"cpus": os.cpu_count()},
        "seconds": seconds,
        "attacks": {},
    }
    settings = {"store": store, "auth": "on", "run_builds": False, "metrics_public": True}
    with replica(directory / "replica", **settings) as one:
        with contextmanager(ask_over_http)(one.url, MAP, TIMEOUT_S, ours) as ask:
            for _ in range(WARM_UP_QUERIES):
                ask(body)
        for name in attacks:
            quiet, attacked = Watch(one, ours, body), Watch(one, ours, body)
            quiet.run(seconds)
            with _attacked(one, name, (digest, theirs), seconds + TIMEOUT_S, share) as attackers:
                attacked.run(seconds)
            figures["attacks"][name] = {
                "quiet": quiet.figures(),
                "attacked": attacked.figures(),
                "p99_ratio": round(attacked.p99_ms / quiet.p99_ms, 2),
                "attackers": dict(attackers),
            }
            _wait_until_forgotten(one)
            figures["attacks"][name]["after_mb"] = _resident_mb(one)
    found = figures["attacks"].values()
    figures["failed"] = sum(one["attacked"]["failed"] for one in found)
    figures["held"] = figures["failed"] == 0 and all(one["p99_ratio"] < MAX_RATIO for one in found)
    return figures


def table(figures: dict[str, Any]) -> str:
    """For people."""
    heads = f"{'p99 ms':>9}{'quiet':>8}{'ratio':>7}{'slowest':>9}{'MB':>7}{'quiet':>7}{'after':>7}"
    lines = [f"{'attack':<20}{'queries':>9}{'failed':>8}{heads}"]
    for name, one in figures["attacks"].items():
        quiet, attacked = one["quiet"], one["attacked"]
        lines.append(
            f"{name:<20}{attacked['queries']:>9}{attacked['failed']:>8}{attacked['p99_ms']:>9.1f}"
            f"{quiet['p99_ms']:>8.1f}{one['p99_ratio']:>7.2f}{attacked['slowest_ms']:>9.1f}"
            f"{attacked['most_mb']:>7.0f}{quiet['most_mb']:>7.0f}{one['after_mb']:>7.0f}"
        )
    return "\n".join(lines)


class Watch:
    """Another caller during a block: its queries, its calls of /caller, the health checks, and the memory.

    The calls need neither the store nor a query worker. Queries go over kept connections and over new ones.
    """

    def __init__(self, one: Replica, key: str, body: Body) -> None:
        self._one = one
        robots = [
            Crowd(partial(ask_over_http, one.url, MAP, TIMEOUT_S, key, keep_alive=kept), [body], 1, PAUSE_S)
            for kept in (True, False)
        ]
        caller, health = (
            Crowd(partial(_get, one.url, path, key), [body], 1, CALL_PAUSE_S)
            for path in ("/caller", "/healthz")
        )
        self._crowds = {"query": robots, "caller": [caller], "healthz": [health]}
        self._most_mb = 0.0

    @property
    def p99_ms(self) -> float:
        return float(np.percentile(self._seconds("query") or [np.inf], 99)) * 1e3

    def run(self, seconds: float) -> None:
        """Ask for so long, and until each has been answered once. What is under way then is waited for."""
        every = [crowd for crowds in self._crowds.values() for crowd in crowds]
        with ExitStack() as running:
            for crowd in every:
                running.enter_context(crowd)
            until = time.monotonic() + seconds
            while time.monotonic() < until or not all(crowd.asked.outcomes for crowd in every):
                self._most_mb = max(self._most_mb, _resident_mb(self._one))
                time.sleep(CALL_PAUSE_S)

    def figures(self) -> dict[str, Any]:
        failures = Counter(
            {
                f"{what}: {outcome}": count
                for what, crowds in self._crowds.items()
                for crowd in crowds
                for outcome, count in crowd.asked.outcomes.items()
                if outcome != "ok"
            }
        )
        seconds = self._seconds("query")
        return {
            "queries": len(seconds),
            "failed": failures.total(),
            "failures": sorted(failures),
            "p50_ms": round(float(np.median(seconds)) * 1e3, 1) if seconds else None,
            "p99_ms": round(self.p99_ms, 1),
            "slowest_ms": round(max(seconds, default=np.inf) * 1e3, 1),
            "slowest_call_ms": round(max(self._seconds("caller"), default=np.inf) * 1e3, 1),
            "most_mb": round(self._most_mb, 1),
        }

    def _seconds(self, what: str) -> list[float]:
        return [seconds for crowd in self._crowds[what] for seconds in crowd.asked.seconds]


def _get(url: str, path: str, key: str) -> Iterator[Ask]:
    """Get the path over a new connection each time."""

    def ask(body: Body) -> str:
        try:
            answer = httpx.get(f"{url}{path}", headers={"Authorization": f"Bearer {key}"}, timeout=TIMEOUT_S)
        except httpx.TransportError as error:
            return type(error).__name__
        return "ok" if answer.is_success else str(answer.status_code)

    yield ask


def _resident_mb(one: Replica) -> float:
    """Memory of the service's own process: answers wait there, while queries run in others."""
    status = Path(f"/proc/{one.pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0]) / 1024


def _with_large_cloud(version: Path, folder: Path) -> Path:
    """A copy of the version with a cloud of as many points as one request may ask for."""
    shutil.copytree(version, folder, ignore=shutil.ignore_patterns("manifest.json"))
    points = (folder / CLOUD_POINTS).read_bytes()
    times = -(-CLOUD_POINTS_ASKED * POINT_BYTES // len(points))
    (folder / CLOUD_POINTS).write_bytes((points * times)[: CLOUD_POINTS_ASKED * POINT_BYTES])
    return folder


@contextmanager
def _attacked(
    one: Replica, name: str, aim: tuple[str, str], at_most_s: float, share: float
) -> Iterator[dict[str, int]]:
    """Under attack as long as the block lasts. What the attackers saw is there after it.

    Args:
        aim: the version, and the attacker's key.
    """
    seen: dict[str, int] = {}
    version, key = aim
    command = [sys.executable, "-m", "firstfix_lab.drills.hostile.attackers", name]
    command += ["--port", str(one.port), "--map", MAP, "--version", version, "--key", key]
    command += ["--points", str(CLOUD_POINTS_ASKED), "--seconds", str(at_most_s), "--share", str(share)]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        if process.stdout.readline() != b"begun\n":
            raise RuntimeError(f"the attackers did not begin: {name}")
        yield seen
        process.terminate()
        seen |= json.loads(process.stdout.read() or b"{}")
    finally:
        process.kill()
        process.wait()


def _wait_until_forgotten(one: Replica) -> None:
    """Until the service has nothing more to do with the last attack."""
    until = time.monotonic() + 2 * TIMEOUT_S
    while time.monotonic() < until:
        shown = httpx.get(f"{one.url}/metrics", timeout=TIMEOUT_S).raise_for_status().text
        connections = next(line for line in shown.splitlines() if line.startswith(f"{CONNECTIONS} "))
        if float(connections.split()[1]) <= 1:  # this one
            return
        time.sleep(0.2)
