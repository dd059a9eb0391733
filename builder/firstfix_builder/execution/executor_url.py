"""URL of a build's executor: ``threads`` of this machine, or the workers of a Dask cluster.

threads
dask://scheduler:8786
dask+tls://scheduler:8786     with the certificates of Dask's own configuration
"""

from __future__ import annotations

from urllib.parse import urlsplit

from firstfix.errors import InvalidOption
from firstfix.store.url import StoreUrl

THREADS = "threads"
_SCHEMES = {"dask": "tcp", "dask+tls": "tls"}


def check_reachable(store_url: str) -> None:
    """Checks that other machines can reach a store.

    Raises:
        InvalidOption: it is in the memory of this process.
    """
    if StoreUrl.parse(store_url).scheme == "memory":
        raise InvalidOption("workers of a cluster cannot share a store in memory")


def dask_address(executor: str) -> str | None:
    """The scheduler's address in the form of Dask, such as tcp://scheduler:8786; None for threads.

    Raises:
        InvalidOption: the executor is neither, or an address is incomplete.
    """
    if executor == THREADS:
        return None
    parts = urlsplit(executor)
    if parts.scheme not in _SCHEMES:
        raise InvalidOption(
            f"no executor {executor!r}: it is {THREADS}, dask://HOST:PORT or dask+tls://HOST:PORT"
        )
    try:
        port = parts.port
    except ValueError:
        port = None
    if not parts.hostname or port is None or not 1 <= port <= 65535:
        raise InvalidOption(f"{executor!r} names no scheduler: {parts.scheme}://HOST:PORT, such as :8786")
    if parts.username is not None or parts.path not in ("", "/") or parts.query or parts.fragment:
        raise InvalidOption(f"an executor is {parts.scheme}://HOST:PORT, without user, path or query")
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return f"{_SCHEMES[parts.scheme]}://{host}:{port}"
