"""The cost of each stage of a build, kept beside its result: a second run finds both."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..common.memory import pss_of_family

POLL_S = 0.5


@contextmanager
def spent(path: Path) -> Iterator[None]:
    """Writes the cost of a block into a JSON file: seconds, processor seconds and peak memory.

    The memory is of this process and its children (Linux). A block that fails leaves no file.
    """
    peak, stop = pss_of_family(os.getpid()), threading.Event()

    def watch() -> None:
        nonlocal peak
        while not stop.wait(POLL_S):
            peak = max(peak, pss_of_family(os.getpid()))

    watcher = threading.Thread(target=watch, daemon=True)
    wall, cpu = time.perf_counter(), time.process_time()
    watcher.start()
    try:
        yield
    finally:
        stop.set()
        watcher.join()
    figures = {
        "seconds": round(time.perf_counter() - wall, 1),
        "cpu_seconds": round(time.process_time() - cpu, 1),
        "peak_mb": round(max(peak, pss_of_family(os.getpid())) / 1e6),
    }
    path.write_text(json.dumps(figures))
