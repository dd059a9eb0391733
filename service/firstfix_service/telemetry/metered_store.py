"""An object store whose operations are timed and whose failures are counted."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable
from typing import Any

from firstfix.errors import StoreError
from firstfix.store.store import Store

from .metrics import Metrics

# Store's calls that ask something of the store; the others are made of these.
OPERATIONS = (
    *("put_new", "put", "put_pieces", "put_file"),
    *("get", "get_range", "download", "sha256", "size", "scan", "folders", "delete"),
)


def metered(store: Store, metrics: Metrics) -> Store:
    """The same store, which from now on tells the metrics what it does, and which records are damaged.

    An operation that is made of others counts once, as what the caller asked for.
    """
    inside = threading.local()

    def timed(name: str) -> Callable[..., Any]:
        seconds = metrics.store_seconds.labels(name)

        @functools.wraps(getattr(store, name))
        def run(*args: Any, **kwargs: Any) -> Any:
            call = functools.partial(getattr(type(store), name), store)
            if getattr(inside, "one", False):
                return call(*args, **kwargs)
            inside.one = True
            start = time.perf_counter()
            try:
                return call(*args, **kwargs)
            except StoreError as error:
                metrics.store_errors.labels(name, error.code).inc()
                raise
            finally:
                inside.one = False
                seconds.observe(time.perf_counter() - start)

        return run

    store.unreadable.listen(lambda error: metrics.unreadable_records.labels(error.kind).inc())
    for name in OPERATIONS:
        setattr(store, name, timed(name))
    return store
