"""Processor time of a query beside the localizer: from the socket to the answer, by process.

python -m benchmarks.service.request_path [--checkout DIR ...] [--rounds N]

The service is real (HTTP server, worker processes, zenoh), but its localizer takes no time, see
``instant_engine``; with ``--localizer`` it is real, too. Other checkouts are measured in turn with this one.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix_client.steps.scan_body import BodyForm, encoded

from ..common.load import Body
from ..common.programs import Replica, free_port
from ..common.small_map import make_small_map

HERE = Path(__file__).parents[2]
INSTANT = Path(__file__).with_name("instant_engine")
PACKAGES = ("core", "builder", "service", "clients/python", "cli")
POINTS = 120_000
SEED = 6


@dataclass(frozen=True)
class Spent:
    """Processor time and context switches of a process since it started."""

    cpu_ns: int
    switches: int

    @classmethod
    def of(cls, pid: int) -> Spent:
        cpu_ns = switches = 0
        for task in Path(f"/proc/{pid}/task").iterdir():
            cpu_ns += int((task / "schedstat").read_text().split()[0])
            for line in (task / "status").read_text().splitlines():
                if line.startswith("voluntary_ctxt_switches"):
                    switches += int(line.split()[1])
        return cls(cpu_ns, switches)


def dense_scan(version: Path) -> Scan:
    """A scan of ``POINTS`` points on the surfaces of the small map."""
    points = np.load(version / "map_points.npy").astype(np.float64)[:, :3]
    seen = points - np.load(version / "template_position_m.npy")[0]
    rng = np.random.default_rng(SEED)
    chosen = seen[rng.integers(len(seen), size=POINTS)] + rng.normal(0, 0.01, (POINTS, 3))
    azimuth = np.argsort(np.arctan2(chosen[:, 1], chosen[:, 0]))
    return Scan(chosen[azimuth].astype(np.float32))


def bodies_of(scan: Scan, version: Path) -> dict[str, Body]:
    raw = scan.points.astype("<f4").tobytes()
    head = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {POINTS}\n"
        f"HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {POINTS}\nDATA binary\n"
    )
    parameters = DescriptorParameters.from_engine(json.loads((version / "engine.json").read_text()))
    forms = {
        "points": BodyForm("scan"),
        "range_image": BodyForm("range_image"),
        "compact": BodyForm("compact", parameters),
        "descriptor": BodyForm("descriptor", parameters),
    }
    return {
        "xyz": Body("application/vnd.firstfix.xyz", raw),
        "pcd": Body("application/x-pcd", head.encode() + raw),
        **{name: Body(*encoded(scan, form)) for name, form in forms.items()},
    }


class Contestant:
    """The service of one checkout."""

    def __init__(self, checkout: Path, store: str, directory: Path, *, instant: bool) -> None:
        folders = [str(INSTANT)] if instant else []
        folders += [str(checkout / package) for package in PACKAGES]
        settings: dict[str, object] = {
            "store": store,
            "run_builds": False,
            "workers": 2,
            "zenoh": True,
            "zenoh_listen": [f"tcp/127.0.0.1:{free_port()}"],
            "log_level": "info",
        }
        self.name = checkout.name
        self.service = Replica(directory, settings, environment={"PYTHONPATH": os.pathsep.join(folders)})

    def pids(self) -> dict[str, list[int]]:
        own = self.service.pid
        children = Path(f"/proc/{own}/task/{own}/children").read_text().split()
        threads = [
            c for t in Path(f"/proc/{own}/task").iterdir() for c in (t / "children").read_text().split()
        ]
        return {"server": [own], "workers": sorted({int(pid) for pid in (*children, *threads)})}

    def spent(self) -> dict[str, Spent]:
        found = {}
        for role, pids in self.pids().items():
            each = [Spent.of(pid) for pid in pids]
            found[role] = Spent(sum(s.cpu_ns for s in each), sum(s.switches for s in each))
        return found


@contextmanager
def http_asker(one: Contestant) -> Iterator[Callable[[Body], None]]:
    """Asks over one kept connection with as little work of its own as possible."""
    host, port = urlsplit(one.service.url).netloc.split(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def ask(body: Body) -> None:
            head = (
                f"POST /localize?map=yard HTTP/1.1\r\nHost: x\r\nContent-Type: {body.media_type}\r\n"
                f"Content-Length: {len(body.content)}\r\n\r\n"
            )
            connection.sendall(head.encode() + body.content if len(body.content) < 65536 else head.encode())
            if len(body.content) >= 65536:
                connection.sendall(body.content)
            got = b""
            while b"\r\n\r\n" not in got:
                got += connection.recv(65536)
            head_bytes, _, content = got.partition(b"\r\n\r\n")
            assert head_bytes.startswith(b"HTTP/1.1 200"), got
            length = next(
                int(line.split(b":")[1])
                for line in head_bytes.split(b"\r\n")
                if line.lower().startswith(b"content-length")
            )
            while len(content) < length:
                content += connection.recv(65536)

        yield ask


@contextmanager
def zenoh_asker(one: Contestant) -> Iterator[Callable[[Body], None]]:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([one.service.endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)

    def ask(body: Body) -> None:
        replies = session.get("firstfix/yard/localize", payload=body.content, encoding=body.media_type)
        assert [reply.ok is not None for reply in replies] == [True]

    try:
        yield ask
    finally:
        session.close()


def measure(one: Contestant, ask: Callable[[Body], None], body: Body, queries: int) -> dict[str, float]:
    for _ in range(5):
        ask(body)
    before, times = one.spent(), []
    for _ in range(queries):
        begin = time.perf_counter()
        ask(body)
        times.append(time.perf_counter() - begin)
    after = one.spent()
    found = {"ms": float(np.median(times)) * 1e3, "p95_ms": float(np.percentile(times, 95)) * 1e3}
    for role in after:
        found[f"{role}_cpu_ms"] = (after[role].cpu_ns - before[role].cpu_ns) / queries / 1e6
        found[f"{role}_switches"] = (after[role].switches - before[role].switches) / queries
    return found


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.service.request_path", description=__doc__)
    parser.add_argument("--checkout", type=Path, action="append", default=[], help="another checkout")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--queries", type=int, default=100)
    parser.add_argument("--localizer", action="store_true", help="with the localizer's own time")
    parser.add_argument("--body", action="append", help="only this form of body; may be repeated")
    parser.add_argument("--transport", action="append", choices=("http", "zenoh"))
    parser.add_argument("--version", type=Path, help="files of a version; default: one of a small map, built")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder, ExitStack() as stack:
        directory = Path(folder)
        version = chosen.version or make_small_map(directory / "map")
        bodies = bodies_of(dense_scan(version), version)
        store = str(directory / "store")
        publish(version, store)
        contestants = []
        for number, checkout in enumerate([HERE, *(path.resolve() for path in chosen.checkout)]):
            one = Contestant(
                checkout,
                store,
                directory / str(number),
                instant=not chosen.localizer,
            )
            stack.callback(one.service.end)
            one.service.start().wait_until_ready()
            contestants.append(one)
        askers = {"http": http_asker, "zenoh": zenoh_asker}
        rows: dict[tuple[str, ...], list[dict[str, float]]] = {}
        for transport in chosen.transport or askers:
            ask = [stack.enter_context(askers[transport](one)) for one in contestants]
            for form, body in bodies.items():
                if chosen.body and form not in chosen.body:
                    continue
                for _ in range(chosen.rounds):
                    for one, how in zip(contestants, ask, strict=True):
                        key = (transport, form, str(len(body.content)), one.name)
                        rows.setdefault(key, []).append(measure(one, how, body, chosen.queries))
        report(rows)


def publish(version: Path, store: str) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "version"
        shutil.copytree(version, folder)
        (folder / "manifest.json").unlink(missing_ok=True)
        Catalog(Store.open(store)).publish("yard", folder, Manifest.for_directory(folder))


def report(rows: dict[tuple[str, ...], list[dict[str, float]]]) -> None:
    """Prints the least of the rounds, which other work on the machine disturbed least."""
    names: list[str] = []
    for key, rounds in rows.items():
        least: dict[str, Any] = {name: min(r[name] for r in rounds) for name in rounds[0]}
        if not names:
            names = list(least)
            print(f"{'transport':9} {'form':12} {'bytes':>8} {'checkout':10}", *(f"{n:>16}" for n in names))
        values = (f"{least[name]:16.3f}" for name in names)
        print(f"{key[0]:9} {key[1]:12} {key[2]:>8} {key[3]:10}", *values)
    sys.stdout.flush()


if __name__ == "__main__":
    main()
