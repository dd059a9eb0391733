"""obstore behind ``firstfix.store.store``: a backend for a URL, and its exceptions as ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

from obstore import exceptions
from obstore.store import AzureStore, GCSStore, LocalStore, MemoryStore, S3Store

from ..errors import InvalidOption, NotFound, StoreError, StoreUnavailable
from .aws_credentials import credentials_file
from .url import StoreUrl

# A request that takes longer, or brings nothing for a while, is lost; a chunk's body needs 0.3 MB/s.
_CLIENT = {"connect_timeout": "5s", "read_timeout": "10s", "timeout": "60s"}
# obstore's own default goes on for 3 minutes and so hides a fault from whoever could act on it.
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
    """obstore's store at a URL. Nothing is asked of it yet.

    Args:
        make_directory: of a file store, when it is missing.

    Raises:
        InvalidOption: a cloud's settings are incomplete.
        StoreUnavailable: the directory is missing or cannot be made.
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
    """obstore's exceptions as ours. A missing object is the built-in FileNotFoundError there."""
    try:
        yield
    except (exceptions.AlreadyExistsError, exceptions.PreconditionError, exceptions.NotSupportedError):
        raise
    except FileNotFoundError as error:
        if writing:  # nothing can be missing but the bucket, or the file to send
            raise StoreUnavailable(f"{key}: {_brief(error)}") from None
        raise NotFound(f"no object {key}") from None
    except (exceptions.PermissionDeniedError, exceptions.UnauthenticatedError, PermissionError) as error:
        raise StoreError(f"{key}: the store refuses these credentials ({_brief(error)})") from None
    except (exceptions.BaseError, OSError) as error:
        raise StoreUnavailable(f"{key}: {_brief(error)}") from None


def _brief(error: BaseException) -> str:
    """The first line: the rest of obstore's messages is a dump of its structs."""
    return str(error).strip().split("\n", 1)[0][:300]
