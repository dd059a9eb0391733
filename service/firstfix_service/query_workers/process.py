"""A process that answers queries, one at a time: ``python -m firstfix_service.query_workers.process FD FD``.

Two sockets connect it with the service. One carries queries; the other carries versions to load and to drop,
so that a load does not delay queries. The process ends when the service ends for any reason, because
the kernel then closes the sockets.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection

from firstfix.errors import FirstfixError

from .base import QueryWorkerThreads
from .query import Query, ServedVersion, load_localizer

LOAD, DROP, HELLO = "load", "drop", "hello"


def main(queries: Connection, control: Connection) -> None:
    """Answers queries until the service is gone."""
    for number in (signal.SIGINT, signal.SIGTERM):  # for the service, which still finishes queries
        signal.signal(number, signal.SIG_IGN)
    workers = QueryWorkerThreads(load_localizer)
    threading.Thread(target=_obey, args=(control, workers), daemon=True, name="control").start()
    while True:
        try:
            query: Query = queries.recv()
            body = queries.recv_bytes()
        except (EOFError, OSError):
            return
        reply = _outcome(partial(workers.answer, replace(query, body=body)))
        del query, body
        try:
            queries.send(reply)
        except OSError:
            return


def _obey(control: Connection, workers: QueryWorkerThreads) -> None:
    do: dict[str, Callable[[ServedVersion], object]] = {
        LOAD: workers.load,
        DROP: workers.drop,
        HELLO: lambda _: None,
    }
    try:
        while True:
            what, version = control.recv()
            control.send(_outcome(partial(do[what], version)))
    except (EOFError, OSError):
        os._exit(0)  # whatever the main thread does: nobody waits for it any more


def _outcome(work: Callable[[], object]) -> tuple[bool, object]:
    """Returns (True, result), (False, our error), or (False, traceback of a defect)."""
    try:
        return True, work()
    except FirstfixError as error:
        return False, type(error)(str(error))  # without its cause, which may not be picklable
    except Exception:
        return False, traceback.format_exc()


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])), Connection(int(sys.argv[2])))
