"""A process that answers queries, one at a time.

    python -m firstfix_service.query_workers.worker QUERIES CONTROL BODIES CAPACITY COUNTS

QUERIES and CONTROL are sockets to the service, BODIES is the file of its ``BodyMemory`` with CAPACITY bytes:
all three are numbers of open files. COUNTS is 1 if the sightings of localized queries are counted, or 0.
One socket carries queries; the other carries versions to load and to drop, and sightings, so that these do
not delay queries. The process ends when the service ends for any reason, because the kernel then closes the
sockets.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from firstfix.engine.deadline import Deadline
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import FirstfixError

from .freed_memory import return_freed
from .localizers import Localizers
from .look import Answered, Asked
from .protocol import DROP, HELLO, LOAD, TAKE, WARM, MessageReader, mapped_bodies, reply_of, send_all
from .query import ServedVersion
from .sightings.counter import Sighted, SightingCounter

SWITCH_S = 0.0005  # for which a query waits at most while the thread that counts sightings runs Python code


def load_localizer(directory: Path) -> Localizer:
    """The localizer of a version's folder."""
    return Localizer(MapIndex.load(directory))


def main(
    queries: socket.socket,
    control: Connection,
    cancelled: memoryview,
    bodies: memoryview,
    counts_sightings: bool,
) -> None:
    """Answers queries until the service is gone."""
    for ending in (signal.SIGINT, signal.SIGTERM):  # for the service, which still finishes queries
        signal.signal(ending, signal.SIG_IGN)
    sightings = SightingCounter() if counts_sightings else None
    sys.setswitchinterval(SWITCH_S)
    localizers = Localizers(load_localizer, len(bodies), sightings)
    serve = partial(_serve_control, control, localizers, sightings)
    threading.Thread(target=serve, daemon=True, name="control").start()
    reader = MessageReader()
    while True:
        try:
            received = reader.receive(queries)
            if received is None:
                continue
            asked, inline, shared_bytes, number = received
            deadline = Deadline(asked.deadline, cancelled, number)
            good, value = _outcome(
                partial(_answer, localizers, asked, inline, bodies[:shared_bytes], deadline)
            )
            del received, asked, inline
            reader.forget()
            send_all(queries, reply_of(good, value))
            if sightings is not None:
                sightings.wake()
        except (EOFError, OSError):
            return


def _answer(
    localizers: Localizers, asked: Asked, inline: memoryview, shared: memoryview, deadline: Deadline
) -> Answered:
    return localizers.answer(asked.filled(body=shared or inline), deadline)


def _serve_control(control: Connection, localizers: Localizers, sightings: SightingCounter | None) -> None:
    do: dict[str, Callable[[ServedVersion], object]] = {
        LOAD: localizers.load,
        WARM: localizers.warm_up,
        DROP: partial(_drop, localizers),
        HELLO: lambda _: None,
        TAKE: lambda _: Sighted() if sightings is None else sightings.take(),
    }
    try:
        while True:
            what, version = control.recv()
            control.send(_outcome(partial(do[what], version)))
    except (EOFError, OSError):
        os._exit(0)  # whatever the main thread does: nobody waits for it any more


def _drop(localizers: Localizers, version: ServedVersion) -> None:
    localizers.drop(version)
    return_freed()


def _outcome(work: Callable[[], object]) -> tuple[bool, object]:
    """(True, result), (False, our error), or (False, traceback of a defect)."""
    try:
        return True, work()
    except FirstfixError as error:
        return False, type(error)(str(error))  # without its cause, which may not be picklable
    except Exception:
        return False, traceback.format_exc()


if __name__ == "__main__":
    number, control_number, file, max_body_bytes, counts_sightings = map(int, sys.argv[1:6])
    main(
        socket.socket(fileno=number),
        Connection(control_number),
        *mapped_bodies(file, max_body_bytes),
        bool(counts_sightings),
    )
