"""Metrics of an object store: times of operations, failures and damaged records."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable
from typing import Any

from firstfix.errors import StoreError
from firstfix.store.store import Store

from .metrics import Metrics

# The methods of Store that make requests; its other methods use these.
OPERATIONS = (
    *("put_new", "put", "put_pieces", "put_file"),
    *("get", "get_range", "download", "sha256", "size", "last_modified", "scan", "folders", "delete"),
)


def metered(store: Store, metrics: Metrics) -> Store:
    """Make a store report its operations and damaged records to the metrics, and return the same store.

    An operation that uses other operations counts once, under its own name.
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
