"""Queries with which a worker warms up a version, beside the queries of others."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from typing import TypeVar

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.warm_up import own_scans
from firstfix.wire.scan import MEDIA_TYPE, encode_scan

from .query import BodyFormat, Query, ServedVersion

T = TypeVar("T")
WITHIN_S = 0.5  # then no further query begins, and one that runs climbs to no further step of effort
# Not the lowest: a query waits for this thread while it holds the interpreter's lock.
NICENESS = 5


def own_queries(version: ServedVersion, index: MapIndex) -> Iterator[Query]:
    """Yield queries with scans of the version's own map, until ``WITHIN_S`` have passed."""
    end = time.monotonic() + WITHIN_S
    for scan in own_scans(index):
        if time.monotonic() > end:
            return
        yield Query(
            (version.map_id,),
            LocalizeOptions(),
            BodyFormat.of(MEDIA_TYPE, None),
            deadline=end,
            body=encode_scan(scan),
            versions=(version,),
        )


def at_low_priority(work: Callable[[], T]) -> T:
    """The result of work in a thread that gives way to other threads. Blocks."""
    result: Future[T] = Future()

    def run() -> None:
        if sys.platform == "linux":  # there the priority is that of one thread
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        try:
            result.set_result(work())
        except BaseException as error:
            result.set_exception(error)

    threading.Thread(target=run, name="warm-up", daemon=True).start()
    return result.result()
