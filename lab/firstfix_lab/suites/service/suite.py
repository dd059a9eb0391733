"""The running service, from a version of 100,000 templates.

firstfix-lab service [--quick] [--json FILE]
firstfix-lab service_parts --version DIR --scans SCANS.npz --part replicas
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firstfix_cli.free_port import free_port
from firstfix_lab.checkout import BENCH

from ...common.programs import replica
from ...common.worlds import WORLDS
from .consoles import ConsoleCourse, consoles
from .loading import cold_load, hot_swap
from .queried_version import QueriedVersion, make_queried_version
from .replica_memory import replica_memory
from .replicas import Course, replicas_suite
from .throughput import body_of, overhead, throughput

WORK = BENCH / "service"
PARTS = (
    "overhead",
    "throughput",
    "cold_load",
    "hot_swap",
    "replicas",
    "replica_memory",
    "consoles",
)


@dataclass(frozen=True)
class Sizes:
    """Length of each part.

    Attributes:
        worlds: the version of the first one that is there is asked.
        clients: numbers of those who ask at the same time; each number asks for ``throughput_s``.
        swaps: changes of versions.
        workers: of the replicas whose memory is told.
    """

    worlds: tuple[str, ...] = ("campus",)
    scans: int = 60
    clients: tuple[int, ...] = (1, 4, 16, 64)
    throughput_s: float = 10.0
    swaps: int = 6
    workers: tuple[int, ...] = (1, 2, 4)
    replicas: Course = field(default_factory=Course)
    consoles: ConsoleCourse = field(default_factory=ConsoleCourse)


FULL = Sizes()
QUICK = Sizes(
    worlds=("warehouse_aws_small", "factory"),
    scans=10,
    clients=(1, 4),
    throughput_s=1.0,
    swaps=2,
    workers=(1, 2),
    replicas=Course(replicas=2, calm_s=1.0, cut_s=2.0),
    consoles=ConsoleCourse(points=300_000, templates=100_000, phase_s=4.0, rounds=1),
)


def run(quick: bool) -> dict[str, Any]:
    """The quick suite asks in the smallest world, and shortly."""
    sizes = QUICK if quick else FULL
    there = {world.name: world for world in WORLDS if world.missing is None}
    world = next(there[name] for name in sizes.worlds if name in there)
    return measure(make_queried_version(world, WORK, sizes.scans), PARTS, sizes)


def measure(queried: QueriedVersion, parts: Iterable[str], sizes: Sizes) -> dict[str, Any]:
    """The figures of the named parts."""
    figures: dict[str, Any] = {
        "machine": {"cpus": os.cpu_count()},
        "queried": queried.name,
        "templates": queried.templates,
    }
    bodies = [body_of(queried, scan) for scan in queried.scans]
    for part in parts:
        with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder:
            directory = Path(folder)
            if part in ("overhead", "throughput"):
                figures[part] = _with_service(part, queried, directory, sizes)
            elif part == "cold_load":
                figures[part] = cold_load(queried, bodies[0], directory)
            elif part == "hot_swap":
                figures[part] = hot_swap(queried, bodies, directory, swaps=sizes.swaps)
            elif part == "replicas":
                figures[part] = replicas_suite(queried, bodies, directory, sizes.replicas)
            elif part == "replica_memory":
                figures[part] = replica_memory(queried, bodies, directory, sizes.workers)
            elif part == "consoles":
                figures[part] = consoles(queried, bodies, directory, sizes.consoles)
            else:
                raise ValueError(f"no part {part!r}; there are {', '.join(PARTS)}")
        print(part, figures[part], flush=True)
    return figures


def _with_service(part: str, queried: QueriedVersion, directory: Path, sizes: Sizes) -> Any:
    store, endpoint = str(directory / "store"), f"tcp/127.0.0.1:{free_port()}"
    queried.publish(store, "queried", directory)
    settings = {"store": store, "run_builds": False, "queue_size": 128}  # so that 64 clients may wait
    with replica(directory / "replica", zenoh=True, zenoh_listen=[endpoint], **settings) as one:
        if part == "overhead":
            return overhead(one.url, "queried", queried)
        return throughput(one.url, endpoint, "queried", queried, sizes.clients, sizes.throughput_s)
