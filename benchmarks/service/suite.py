"""The running service, from a version of 100,000 templates.

python -m benchmarks.run service [--quick] [--json FILE]
python -m benchmarks.service --version DIR --scans SCANS.npz --part replicas
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from firstfix_cli.free_port import free_port

from ..common.programs import replica
from ..common.worlds import WORLDS
from .consoles import QUICK, ConsoleCourse, consoles
from .loading import cold_load, hot_swap
from .queried_version import QueriedVersion, make_queried_version
from .replica_memory import replica_memory
from .replicas import Course, replicas_suite
from .throughput import body_of, overhead, throughput

WORK = Path(__file__).parents[2] / "build" / "bench" / "service"
SCANS = 60
PARTS = (
    "overhead",
    "throughput",
    "cold_load",
    "hot_swap",
    "replicas",
    "replica_memory",
    "consoles",
)


def run(quick: bool) -> dict[str, Any]:
    """The quick suite asks in the factory, and shortly."""
    name = "factory" if quick else "campus"
    queried = make_queried_version(
        next(world for world in WORLDS if world.name == name), WORK, 10 if quick else SCANS
    )
    return measure(queried, PARTS, quick=quick)


def measure(queried: QueriedVersion, parts: Iterable[str], *, quick: bool = False) -> dict[str, Any]:
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
                figures[part] = _with_service(part, queried, directory, quick)
            elif part == "cold_load":
                figures[part] = cold_load(queried, bodies[0], directory)
            elif part == "hot_swap":
                figures[part] = hot_swap(queried, bodies, directory)
            elif part == "replicas":
                figures[part] = replicas_suite(
                    queried, bodies, directory, Course(cut_s=5.0) if quick else Course()
                )
            elif part == "replica_memory":
                figures[part] = replica_memory(queried, bodies, directory)
            elif part == "consoles":
                figures[part] = consoles(queried, bodies, directory, QUICK if quick else ConsoleCourse())
            else:
                raise ValueError(f"no part {part!r}; there are {', '.join(PARTS)}")
        print(part, figures[part], flush=True)
    return figures


def _with_service(part: str, queried: QueriedVersion, directory: Path, quick: bool) -> Any:
    store, endpoint = str(directory / "store"), f"tcp/127.0.0.1:{free_port()}"
    queried.publish(store, "queried", directory)
    settings = {"store": store, "run_builds": False, "queue_size": 128}  # so that 64 clients may wait
    with replica(directory / "replica", zenoh=True, zenoh_listen=[endpoint], **settings) as one:
        if part == "overhead":
            return overhead(one.url, "queried", queried)
        clients, seconds = ((1, 4), 2.0) if quick else ((1, 4, 16, 64), 10.0)
        return throughput(one.url, endpoint, "queried", queried, clients, seconds)
