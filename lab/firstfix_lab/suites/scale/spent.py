"""The cost of each stage of a build, kept beside its result: a second run finds both."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

from ...common.memory import own_bytes, pss_of_family

POLL_S = 0.5

Cost: TypeAlias = dict[str, float]


def read_cost(path: Path) -> Cost:
    """Read a file of ``spent``."""
    cost: Cost = json.loads(path.read_text())
    return cost


@contextmanager
def spent(path: Path) -> Iterator[None]:
    """Write the cost of a block into a JSON file: seconds, processor seconds and peak memory.

    The file is written over and over, and what it said before is added: a block that was killed goes on.
    The memory is of this process and its children with the pages of files that they have mapped
    (``peak_mb``), and of this process without them (``peak_own_mb``) (Linux).
    """
    before = read_cost(path) if path.exists() else {}
    wall, cpu = time.perf_counter(), time.process_time()
    peak, peak_own, stop = 0, 0, threading.Event()

    def measure() -> None:
        nonlocal peak, peak_own
        peak, peak_own = max(peak, pss_of_family(os.getpid())), max(peak_own, own_bytes(os.getpid()))
        figures = {
            "seconds": round(before.get("seconds", 0) + time.perf_counter() - wall, 1),
            "cpu_seconds": round(before.get("cpu_seconds", 0) + time.process_time() - cpu, 1),
            "peak_mb": max(before.get("peak_mb", 0), round(peak / 1e6)),
            "peak_own_mb": max(before.get("peak_own_mb", 0), round(peak_own / 1e6)),
        }
        part = path.with_suffix(".part")
        part.write_text(json.dumps(figures))
        part.replace(path)

    def watch() -> None:
        while not stop.wait(POLL_S):
            measure()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        stop.set()
        watcher.join()
        measure()
