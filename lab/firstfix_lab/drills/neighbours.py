"""Two callers of one map: one behaves well, the other floods the service with all that it may ask.

    firstfix-lab neighbours [--seconds 10] [--flood NAME] [--root CHECKOUT] [--json FILE]

Every flood of ``floods`` in turn, then 250 connections of one key on each route of the app. The
first caller asks ten times a second, up to four queries at a time. All are to be answered, with a p99 of at
most twice the one alone plus the time of one query of the flood, and probes of health within a second.
--root takes the service of another checkout, which has a .venv; several times for a comparison.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
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
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store
from firstfix_lab.checkout import ROOT
from tests.claimed import free_port

from ..common.load import Body
from ..common.programs import Replica
from ..common.small_map import make_small_map, query_of
from .flooders import all_floods
from .floods import HEAVY_POINTS, LARGEST_POINTS, XYZ, random_returns

MAP = "yard"
EVERY_S, MAX_AT_ONCE = 0.1, 4
TIMEOUT_S = 120.0  # of a query: it is then lost
SETTLE_S = 120.0  # at most, until the service has nothing more to do with the last flood
OWN_ADDRESS, PROBE_ADDRESS = "127.0.0.11", "127.0.0.12"
PROBE_EVERY_S, PROBE_WITHIN_S = 0.25, 1.0  # orchestrators give up after a second, and end the service
PROBES = ("/healthz", "/readyz")
WARM_UP_QUERIES = 20
LEAD_S = 4.0  # of the flood, before the other caller asks beside it


@dataclass
class Seen:
    """The queries of the well-behaved caller.

    Attributes:
        outcomes: how often what: the status, or the error.
        seconds: of those that were answered.
    """

    outcomes: Counter[str] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)

    def figures(self) -> dict[str, Any]:
        p50, p99 = np.percentile(self.seconds, [50, 99]) if self.seconds else (np.inf, np.inf)
        return {
            "asked": self.outcomes.total(),
            "answered": self.outcomes["200"],
            "failed": {name: count for name, count in self.outcomes.items() if name != "200"},
            "p50_ms": round(float(p50) * 1e3, 1),
            "p99_ms": round(float(p99) * 1e3, 1),
            "max_ms": round(max(self.seconds, default=np.inf) * 1e3, 1),
        }


def neighbours(
    version: Path, folder: Path, *, seconds: float, floods: Sequence[str], root: Path = ROOT
) -> dict[str, Any]:
    """The figures of each flood; ``failed`` of each ``robot`` is to be empty.

    Args:
        version: folder of a version's files.
        folder: empty; of the service.
        seconds: of each flood, and of each time alone before it.
        floods: names of ``all_floods``.
        root: the checkout whose service is asked.
    """
    store = folder / "store"
    digest = Catalog(Store.open(str(store))).publish(MAP, version, Manifest.for_directory(version))
    keys = ApiKeys(Store.open(str(store)))
    _, ours = keys.create("robot", Grant.parse(["localize"], ALL_MAPS))
    _, theirs = keys.create("flood", Grant.parse(["build"], ALL_MAPS))
    body = query_of(version)
    figures: dict[str, Any] = {"root": root.name, "seconds": seconds, "floods": {}}
    with _service(folder / "replica", store, root) as one:
        for _ in range(WARM_UP_QUERIES):
            _post(one.url, ours, body)
        for name in floods:
            alone = asyncio.run(_ask(one.url, ours, body, seconds))
            heavy = Body(XYZ, random_returns(LARGEST_POINTS if name == "largest scans" else HEAVY_POINTS))
            one_query_s = _post(one.url, theirs, heavy)
            with _flooded(one, name, (digest, theirs), seconds) as flooder:
                beside, probed_s = asyncio.run(_ask_and_probe(one.url, ours, body, seconds))
            _wait_until_idle(one)
            quiet, met = alone.figures(), beside.figures()
            bar_ms = 2 * quiet["p99_ms"] + one_query_s * 1e3
            is_in_time = met["p99_ms"] <= bar_ms and probed_s <= PROBE_WITHIN_S
            figures["floods"][name] = {
                "alone": quiet,
                "robot": met,
                "one_query_ms": round(one_query_s * 1e3),
                "bar_ms": round(bar_ms),
                "probe_max_ms": round(probed_s * 1e3, 1),
                "held": not met["failed"] and is_in_time,
                "flooder": dict(flooder),
            }
            print(_row(name, figures["floods"][name]), flush=True)
    return figures


HEAD = (
    f"{'flood':<58}{'answered':>10}{'p50':>8}{'p99':>8}{'max':>8}{'alone':>8}{'p99':>7}{'query':>7}{'bar':>7}"
    f"{'probe':>7}  held  failed; what the flooder met"
)


def _row(name: str, one: dict[str, Any]) -> str:
    met, quiet = one["robot"], one["alone"]
    answered = f"{met['answered']}/{met['asked']}"
    return (
        f"{name:<58}{answered:>10}{met['p50_ms']:>8.0f}{met['p99_ms']:>8.0f}{met['max_ms']:>8.0f}"
        f"{quiet['p50_ms']:>8.0f}{quiet['p99_ms']:>7.0f}{one['one_query_ms']:>7}{one['bar_ms']:>7}"
        f"{one['probe_max_ms']:>7.0f}"
        f"  {'yes' if one['held'] else 'NO':<4}  {met['failed'] or 'none'}; {one['flooder']}"
    )


@contextmanager
def _service(folder: Path, store: Path, root: Path) -> Iterator[Replica]:
    python = sys.executable if root == ROOT else str(root / ".venv" / "bin" / "python")
    settings = {
        "store": store,
        "auth": "on",
        "localize_per_s": 50,  # as where a service is exposed
        "workers": 2,
        "run_builds": False,
        "metrics_public": True,
        "recorded_share": 1.0,
        "log_level": "warning",
        "zenoh": True,
        "zenoh_listen": [f"tcp/127.0.0.1:{free_port()}"],
    }
    command = [python, str(ROOT / "tests" / "patched_cli.py"), "serve"]
    constants = {"CONSTANTS": json.dumps({"recorded_per_minute": 600})}
    one = Replica(folder, settings, command, constants).start()
    try:
        one.wait_until_ready()
        yield one
    finally:
        one.end()


async def _ask(url: str, key: str, body: Body, seconds: float) -> Seen:
    """Ask every ``EVERY_S``, and wait for all answers."""
    seen = Seen()
    transport = httpx.AsyncHTTPTransport(local_address=OWN_ADDRESS)
    free = asyncio.Semaphore(MAX_AT_ONCE - 1)
    limits = {"timeout": TIMEOUT_S, "transport": transport}

    async def ask(http: httpx.AsyncClient) -> None:
        try:
            await ask_once(http)
        finally:
            free.release()

    async def ask_once(http: httpx.AsyncClient) -> None:
        begin = time.perf_counter()
        try:
            answer = await http.post(
                "/localize", params={"map": MAP}, content=body.content, headers=_headers(key, body)
            )
        except httpx.TransportError as error:
            seen.outcomes[type(error).__name__] += 1
            return
        seen.outcomes[str(answer.status_code)] += 1
        if answer.is_success:
            seen.seconds.append(time.perf_counter() - begin)

    async with httpx.AsyncClient(base_url=url, **limits) as http, asyncio.TaskGroup() as asked:  # type: ignore[arg-type]
        for _ in range(max(1, round(seconds / EVERY_S))):
            asked.create_task(ask(http))
            await asyncio.sleep(EVERY_S)
            await free.acquire()
    return seen


async def _ask_and_probe(url: str, key: str, body: Body, seconds: float) -> tuple[Seen, float]:
    """Ask as ``_ask``, and probes health meanwhile. Returns also the seconds of the longest probe."""
    probing = asyncio.create_task(_probe(url, round(seconds / PROBE_EVERY_S)))
    seen = await _ask(url, key, body, seconds)
    return seen, await probing


async def _probe(url: str, times: int) -> float:
    """Seconds of the longest probe, each on a connection of its own; infinite where one failed."""
    longest_s = 0.0
    for number in range(max(1, times)):
        transport = httpx.AsyncHTTPTransport(local_address=PROBE_ADDRESS)
        begin = time.perf_counter()
        try:
            async with httpx.AsyncClient(base_url=url, transport=transport, timeout=TIMEOUT_S) as http:
                (await http.get(PROBES[number % len(PROBES)])).raise_for_status()
        except httpx.HTTPError:
            return np.inf
        longest_s = max(longest_s, time.perf_counter() - begin)
        await asyncio.sleep(PROBE_EVERY_S)
    return longest_s


def _post(url: str, key: str, body: Body) -> float:
    """Ask once, and return the seconds that it takes."""
    begin = time.perf_counter()
    answer = httpx.post(
        f"{url}/localize",
        params={"map": MAP},
        content=body.content,
        headers=_headers(key, body),
        timeout=TIMEOUT_S,
    )
    answer.raise_for_status()
    return time.perf_counter() - begin


def _headers(key: str, body: Body) -> dict[str, str]:
    return {"Content-Type": body.media_type, "Authorization": f"Bearer {key}"}


@contextmanager
def _flooded(one: Replica, name: str, aim: tuple[str, str], seconds: float) -> Iterator[dict[str, int]]:
    """Flooded as long as the block lasts. What the flooder met is there after it.

    Args:
        aim: the version, and the flooder's key.
    """
    met: dict[str, int] = {}
    command = [sys.executable, "-m", "firstfix_lab.drills.flooders", name, "--url", one.url, "--map", MAP]
    command += ["--endpoint", one.endpoint, "--version", aim[0], "--key", aim[1]]
    command += ["--seconds", str(seconds + 2 * TIMEOUT_S)]
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        if process.stdout.readline() != b"begun\n":
            raise RuntimeError(f"the flood did not begin: {name}")
        time.sleep(min(LEAD_S, seconds))  # its connections are open, and the queue is full
        yield met
        process.terminate()
        met |= json.loads(process.stdout.read() or b"{}")
    finally:
        process.kill()
        process.wait()


def _wait_until_idle(one: Replica) -> None:
    """Until the service has no query and no body of the last flood."""
    until = time.monotonic() + SETTLE_S
    while time.monotonic() < until:
        shown = httpx.get(f"{one.url}/metrics", timeout=TIMEOUT_S).raise_for_status().text
        values = dict(line.rsplit(" ", 1) for line in shown.splitlines() if line[:1] != "#")
        busy = float(values["firstfix_queries_admitted"]) + float(values["firstfix_body_bytes"])
        if not busy and float(values["firstfix_http_connections"]) <= 1:
            return
        time.sleep(0.2)
    raise RuntimeError("the service still works for a flood that has ended")


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab neighbours", description=__doc__.split("\n\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each flood")
    parser.add_argument(
        "--flood",
        action="append",
        choices=all_floods(),
        metavar="NAME",
        help="this one alone; several times: these",
    )
    parser.add_argument(
        "--root", action="append", type=Path, help="checkout of the service; default: this one"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args(arguments)
    found = []
    with tempfile.TemporaryDirectory(prefix="firstfix-neighbours-") as folder:
        version = make_small_map(Path(folder) / "map")
        for number, root in enumerate(chosen.root or [ROOT]):
            print(f"\n{root.name}, milliseconds\n{HEAD}", flush=True)
            own = Path(folder) / f"service{number}"
            own.mkdir()
            floods = chosen.flood or tuple(all_floods())
            found.append(neighbours(version, own, seconds=chosen.seconds, root=root.resolve(), floods=floods))
    if chosen.json:
        chosen.json.write_text(json.dumps(found, indent=1) + "\n")
    return int(not all(one["held"] for figures in found for one in figures["floods"].values()))
