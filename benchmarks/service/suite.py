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

from ..worlds import WORLDS
from .loading import cold_load, hot_swap
from .many_maps import many_maps
from .place import Place, make_place
from .programs import free_port, replica
from .replica_memory import replica_memory
from .replicas import replicas_suite
from .throughput import body_of, overhead, throughput

WORK = Path(__file__).parents[2] / "build" / "bench" / "service"
SCANS = 60
PARTS = ("overhead", "throughput", "cold_load", "hot_swap", "replicas", "many_maps", "replica_memory")


def run(quick: bool) -> dict[str, Any]:
    """The quick suite asks in the factory, and shortly."""
    name = "factory" if quick else "campus"
    place = make_place(next(world for world in WORLDS if world.name == name), WORK, 10 if quick else SCANS)
    return measure(place, PARTS, quick=quick)


def measure(place: Place, parts: Iterable[str], *, quick: bool = False) -> dict[str, Any]:
    """The figures of the named parts."""
    figures: dict[str, Any] = {
        "machine": {"cpus": os.cpu_count()},
        "place": place.name,
        "templates": place.templates,
    }
    bodies = [body_of(place, scan) for scan in place.scans]
    for part in parts:
        with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder:
            directory = Path(folder)
            if part in ("overhead", "throughput"):
                figures[part] = _with_service(part, place, directory, quick)
            elif part == "cold_load":
                figures[part] = cold_load(place, bodies[0], directory)
            elif part == "hot_swap":
                figures[part] = hot_swap(place, bodies, directory)
            elif part == "replicas":
                figures[part] = replicas_suite(place, bodies, directory, cut_s=5.0 if quick else 60.0)
            elif part == "many_maps":
                figures[part] = many_maps(place, bodies, directory, rounds=1 if quick else 3)
            elif part == "replica_memory":
                figures[part] = replica_memory(place, bodies, directory)
            else:
                raise ValueError(f"no part {part!r}; there are {', '.join(PARTS)}")
        print(part, figures[part], flush=True)
    return figures


def _with_service(part: str, place: Place, directory: Path, quick: bool) -> Any:
    store, endpoint = str(directory / "store"), f"tcp/127.0.0.1:{free_port()}"
    place.publish(store, "place", directory)
    settings = {"store": store, "run_builds": False, "queue_size": 128}  # so that 64 clients may wait
    with replica(directory / "replica", zenoh=True, zenoh_listen=[endpoint], **settings) as one:
        if part == "overhead":
            return overhead(one.url, "place", place)
        clients, seconds = ((1, 4), 2.0) if quick else ((1, 4, 16, 64), 10.0)
        return throughput(one.url, endpoint, "place", place, clients, seconds)
