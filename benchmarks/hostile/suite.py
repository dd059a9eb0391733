"""A service under attack: what the queries of another caller see of it.

python -m benchmarks.run hostile [--quick] [--json FILE]
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import ALL_MAPS, Grant
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import CLOUD_POINTS, Manifest
from firstfix.store.store import Store

from ..common.load import Body
from ..common.programs import Replica, replica
from ..common.small_map import make_small_map, query_of
from .attacks import ATTACKS

MAP = "yard"
CLIENTS = 2
PAUSE_S = 0.05  # between two queries of a client: this caller leaves most of the machine alone
HEALTH_PAUSE_S = 0.2
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
        for _ in range(WARM_UP_QUERIES):
            _ask(one.url, ours, body)
        for name in attacks:
            with _watched(one, ours, body) as quiet:
                time.sleep(seconds)
            with (
                _attacked(one, name, (digest, theirs), seconds + TIMEOUT_S, share) as attackers,
                _watched(one, ours, body) as attacked,
            ):
                time.sleep(seconds)
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


@dataclass
class Seen:
    """The queries of another caller during an attack.

    Attributes:
        calls: seconds of its calls of /caller, which need neither the store nor a query worker.
        failures: of its queries, its calls and the health checks, in words.
        most_mb: memory of the service's process.
    """

    seconds: list[float] = field(default_factory=list)
    calls: list[float] = field(default_factory=list)
    most_mb: float = 0.0
    failures: list[str] = field(default_factory=list)

    @property
    def p99_ms(self) -> float:
        return float(np.percentile(self.seconds, 99)) * 1e3 if self.seconds else float("inf")

    def figures(self) -> dict[str, Any]:
        return {
            "queries": len(self.seconds),
            "failed": len(self.failures),
            "failures": sorted(set(self.failures)),
            "p50_ms": round(float(np.median(self.seconds)) * 1e3, 1) if self.seconds else None,
            "p99_ms": round(self.p99_ms, 1),
            "slowest_ms": round(max(self.seconds, default=float("inf")) * 1e3, 1),
            "slowest_call_ms": round(max(self.calls, default=float("inf")) * 1e3, 1),
            "most_mb": round(self.most_mb, 1),
        }


@contextmanager
def _watched(one: Replica, key: str, body: Body) -> Iterator[Seen]:
    """Asks until the block ends: on connections that are kept and on new ones, and for the health.

    What is under way then is waited for: it may be the slowest of all.
    """
    seen, stop = Seen(), threading.Event()

    def robot(is_kept: bool) -> None:
        with httpx.Client(timeout=TIMEOUT_S) as kept:
            while not (stop.is_set() and (seen.seconds or seen.failures)):  # a busy machine begins late
                begin = time.perf_counter()
                outcome = _ask(one.url, key, body, kept if is_kept else None)
                if outcome == "ok":
                    seen.seconds.append(time.perf_counter() - begin)
                else:
                    seen.failures.append(outcome)
                stop.wait(PAUSE_S)

    def caller() -> None:
        while not (stop.is_set() and (seen.calls or seen.failures)):
            seen.most_mb = max(seen.most_mb, _resident_mb(one))
            begin = time.perf_counter()
            try:
                answer = httpx.get(f"{one.url}/caller", headers=_authorization(key), timeout=TIMEOUT_S)
                if answer.is_success:
                    seen.calls.append(time.perf_counter() - begin)
                else:
                    seen.failures.append(f"caller: {answer.status_code}")
            except httpx.TransportError as error:
                seen.failures.append(f"caller: {type(error).__name__}")
            stop.wait(HEALTH_PAUSE_S)

    def health() -> None:
        while not stop.is_set():
            try:
                answer = httpx.get(f"{one.url}/healthz", timeout=TIMEOUT_S)
                if not answer.is_success:
                    seen.failures.append(f"healthz: {answer.status_code}")
            except httpx.TransportError as error:
                seen.failures.append(f"healthz: {type(error).__name__}")
            stop.wait(HEALTH_PAUSE_S)

    threads = [threading.Thread(target=robot, args=(n % 2 == 0,)) for n in range(CLIENTS)]
    threads += [threading.Thread(target=health), threading.Thread(target=caller)]
    for thread in threads:
        thread.start()
    try:
        yield seen
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def _ask(url: str, key: str, body: Body, http: httpx.Client | None = None) -> str:
    headers = {"Content-Type": body.media_type, **_authorization(key)}
    post = httpx.post if http is None else http.post
    try:
        answer = post(
            f"{url}/localize",
            params={"map": MAP},
            content=body.content,
            headers=headers,
            timeout=TIMEOUT_S,
        )
    except httpx.TransportError as error:
        return type(error).__name__
    return "ok" if answer.is_success else str(answer.status_code)


def _authorization(key: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {key}"}


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
    command = [sys.executable, "-m", "benchmarks.hostile.attackers", name]
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
