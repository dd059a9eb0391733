"""obstore behind ``firstfix.store.store``: opens a backend, writes to it and translates its exceptions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import obstore
from obstore import exceptions
from obstore.store import AzureStore, GCSStore, LocalStore, MemoryStore, S3Store

from ..errors import InvalidOption, NotFound, StoreError, StoreUnavailable, StoreUnsafe
from .aws_credentials import credentials_file
from .url import StoreUrl

_PART_BYTES = 16 << 20  # of a multipart put
# A request that takes longer, or receives nothing for a while, counts as lost; a chunk needs 0.3 MB/s.
_CLIENT = {"connect_timeout": "5s", "read_timeout": "10s", "timeout": "60s"}
# obstore's default retries for 3 minutes, which hides a fault from callers who could act on it.
_RETRY = {
    "max_retries": 4,
    "retry_timeout": timedelta(seconds=20),
    "backoff": {
        "init_backoff": timedelta(milliseconds=100),
        "max_backoff": timedelta(seconds=3),
        "base": 2,
    },
}


def open_backend(where: StoreUrl, *, make_directory: bool = True) -> Any:
    """Open obstore's store at a URL. Sends no request yet.

    Args:
        make_directory: make the directory of a file store if it is missing.

    Raises:
        InvalidOption: a cloud's settings are incomplete.
        StoreUnavailable: the directory is missing, or cannot be made.
    """
    if where.scheme == "memory":
        return MemoryStore()
    if where.scheme == "file":
        root = Path(where.prefix)
        try:
            return LocalStore(prefix=root, mkdir=make_directory)
        except (exceptions.BaseError, OSError, ValueError) as error:
            raise StoreUnavailable(f"no directory {root}: {_brief(error)}") from None
    options: dict[str, Any] = {**where.texts, **where.flags}
    client = {**_CLIENT, "allow_http": bool(options.pop("allow_http", False))}
    if where.scheme == "gs" and "endpoint" in options:
        options["base_url"] = options.pop("endpoint")
    if where.scheme == "s3" and (provider := credentials_file()) is not None:
        options["credential_provider"] = provider
    kind = {"s3": S3Store, "gs": GCSStore, "az": AzureStore}[where.scheme]
    try:
        return kind(
            where.bucket,
            prefix=where.prefix or None,
            client_options=client,
            retry_config=_RETRY,
            **options,
        )
    except (exceptions.BaseError, ValueError) as error:
        raise InvalidOption(f"store {where.scheme}://{where.bucket}: {_brief(error)}") from None


@contextmanager
def translated(key: str, *, writing: bool = False) -> Iterator[None]:
    """Translate obstore's exceptions into ours. obstore reports a missing object as FileNotFoundError."""
    try:
        yield
    except (exceptions.AlreadyExistsError, exceptions.PreconditionError):
        raise
    except (exceptions.NotSupportedError, NotImplementedError) as error:  # obstore raises the builtin one
        raise StoreUnsafe(f"{key}: this store cannot do what is needed: {_brief(error)}") from None
    except FileNotFoundError as error:
        if writing:  # only the bucket, or the file to send, can be missing
            raise StoreUnavailable(f"{key}: {_brief(error)}") from None
        raise NotFound(f"no object {key}") from None
    except (exceptions.PermissionDeniedError, exceptions.UnauthenticatedError, PermissionError) as error:
        raise StoreError(f"{key}: the store refuses these credentials ({_brief(error)})") from None
    except (exceptions.BaseError, OSError) as error:
        raise StoreUnavailable(f"{key}: {_brief(error)}") from None


class BucketWriter:
    """Writer to a cloud's bucket, or to memory."""

    def __init__(self, backend: Any) -> None:
        self._backend = backend

    def create(self, key: str, data: bytes | Path) -> bool:
        """Put with If-None-Match. Returns False if the key exists.

        Raises:
            StoreUnsafe: the settings of the store have no such put.
        """
        try:
            with translated(key, writing=True):
                obstore.put(self._backend, key, data, mode="create")
        except (exceptions.AlreadyExistsError, exceptions.PreconditionError):
            return False
        return True

    def replace(self, key: str, data: bytes | Path) -> None:
        """Put an object, streaming a file."""
        with translated(key, writing=True):
            obstore.put(self._backend, key, data)

    def replace_from_pieces(self, key: str, pieces: Iterable[bytes]) -> None:
        """Put an object as a stream of its pieces."""
        source = iter(pieces)
        with ThreadPoolExecutor(1, thread_name_prefix="pieces") as other:

            def made() -> Iterator[bytes]:
                # obstore iterates inside its event loop, where the iterator could not call obstore itself
                while (piece := other.submit(next, source, None).result()) is not None:
                    yield piece

            with translated(key, writing=True):
                obstore.put(self._backend, key, made(), chunk_size=_PART_BYTES, max_concurrency=2)

    def make_durable(self, key: str) -> None:
        """Do nothing: what a cloud shows is durable."""

    def check_room(self, size_bytes: int, what: str) -> None:
        """Do nothing: nobody knows how much a cloud takes."""

    def delete(self, key: str) -> None:
        """Remove an object. A missing object is no error."""
        with suppress(NotFound), translated(key):
            obstore.delete(self._backend, key)

    def remove_parts(self, before: datetime, *, dry_run: bool) -> list[str]:
        """Do nothing: a rule of the bucket removes unfinished multipart puts."""
        return []


def _brief(error: BaseException) -> str:
    """First line of an error: the rest of obstore's messages is a dump of its structs."""
    return str(error).strip().split("\n", 1)[0][:300]
