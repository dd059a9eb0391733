"""A process that answers queries, one at a time: ``python -m firstfix_service.query_workers.process FD FD``.

It has two sockets to the service. On one come queries, on the other come versions to load and to drop,
so that a load does not hold up queries. It ends when the service does, however that ended: the kernel
closes the sockets.
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

from .base import LocalWorkers
from .query import Query, ServedVersion, load_localizer

LOAD, DROP, HELLO = "load", "drop", "hello"


def main(queries: Connection, control: Connection) -> None:
    """Answers until the service is gone."""
    for number in (signal.SIGINT, signal.SIGTERM):  # meant for the service, which still finishes queries
        signal.signal(number, signal.SIG_IGN)
    workers = LocalWorkers(load_localizer)
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


def _obey(control: Connection, workers: LocalWorkers) -> None:
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
        os._exit(0)  # whatever the main thread is at: nobody waits for it any more


def _outcome(work: Callable[[], object]) -> tuple[bool, object]:
    """(True, result), (False, an error of ours), or (False, the text of a defect)."""
    try:
        return True, work()
    except FirstfixError as error:
        return False, type(error)(str(error))  # without what it was caused by, which may not be picklable
    except Exception:
        return False, traceback.format_exc()


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])), Connection(int(sys.argv[2])))
