"""The one door to object storage: files, memory, S3, Google and Azure behind a dozen calls.

Correctness stands on create-only puts alone, never on rename or compare-and-swap: they work on every
store. ``probe`` finds out a store that only pretends to have them. What is put is durable when the
call returns, also in a directory (it is synced to disk).
"""

from __future__ import annotations

import builtins
import hashlib
import os
import re
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import obstore
from obstore import exceptions
from obstore.store import AzureStore, GCSStore, LocalStore, MemoryStore, S3Store

from .errors import InvalidOption, NotFound, StoreError, StoreUnavailable, StoreUnsafe
from .store_url import StoreUrl

# A request that takes longer than this is lost; a body of one chunk needs 0.3 MB/s.
_CLIENT = {"connect_timeout": "5s", "timeout": "60s"}
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
CHUNK_BYTES = 16 << 20
_SEGMENT = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,199}")
_PART = re.compile(r".+#\d+")  # obstore's own name for a file that is being written; no key has a '#'
_MAX_KEY_CHARS = 900  # S3 allows 1024 with the prefix


@dataclass(frozen=True)
class StoredObject:
    """One object as a listing shows it."""

    key: str
    size_bytes: int
    last_modified: datetime


class Store:
    """Objects by key. Thread-safe.

    Keys are segments of letters, digits, ``.``, ``_`` and ``-`` joined by ``/``; a segment does not
    start with a dot. Every method raises InvalidOption on another key, StoreUnavailable when the
    store does not answer, StoreError when it refuses.
    """

    def __init__(self, backend: Any, *, root: Path | None = None) -> None:
        self._backend = backend
        self._root = root  # the directory of a file store
        self._lasting_folders: set[Path] = set()  # their own entry in their parent is on disk

    @classmethod
    def open(cls, url: str) -> Store:
        """The store at a URL (forms: ``firstfix.store_url``). Nothing is asked of it yet.

        Raises:
            InvalidOption: the URL is of no known form, or a cloud's settings are incomplete.
        """
        return cls.open_at(StoreUrl.parse(url))

    @classmethod
    def open_at(cls, where: StoreUrl) -> Store:
        """As ``open``, of a URL that was parsed before."""
        if where.scheme == "memory":
            return cls(MemoryStore())
        if where.scheme == "file":
            root = Path(where.prefix)
            try:
                return cls(LocalStore(prefix=root, mkdir=True), root=root)
            except (exceptions.BaseError, OSError, ValueError) as error:
                raise StoreUnavailable(f"no directory {root}: {_brief(error)}") from None
        options: dict[str, Any] = {**where.texts, **where.flags}
        client = {**_CLIENT, "allow_http": bool(options.pop("allow_http", False))}
        if where.scheme == "gs" and "endpoint" in options:
            options["base_url"] = options.pop("endpoint")
        kind = {"s3": S3Store, "gs": GCSStore, "az": AzureStore}[where.scheme]
        try:
            backend = kind(
                where.bucket,
                prefix=where.prefix or None,
                client_options=client,
                retry_config=_RETRY,
                **options,
            )
        except (exceptions.BaseError, ValueError) as error:
            raise InvalidOption(f"store {where.scheme}://{where.bucket}: {_brief(error)}") from None
        return cls(backend)

    def put_new(self, key: str, data: bytes | Path) -> bool:
        """Create-only put, atomic. False when the key exists already: of many at once one wins.

        A lost reply can make the winner see False, as its retry meets its own object: whoever must
        know compares the content. A file is read into memory; for large ones see ``upload``.
        """
        check_key(key)
        try:
            with _translated(key, writing=True):
                obstore.put(self._backend, key, data, mode="create")
        except (exceptions.AlreadyExistsError, exceptions.PreconditionError):
            return False
        except exceptions.NotSupportedError:
            raise StoreUnsafe("this store has no create-only put") from None
        self._sync(key)
        return True

    def put(self, key: str, data: bytes) -> None:
        """Atomic put that replaces what was there."""
        check_key(key)
        with _translated(key, writing=True):
            obstore.put(self._backend, key, data)
        self._sync(key)

    def upload(self, key: str, path: Path) -> bool:
        """Puts a file under a key that names its content: for such keys the last of two equal puts
        does no harm. Streams. False when an object of that size is there already and nothing was sent.
        """
        check_key(key)
        size = path.stat().st_size
        with suppress(NotFound):
            if self.size(key) == size:
                return False
        with _translated(key, writing=True):
            obstore.put(self._backend, key, path)
        self._sync(key)
        return True

    def get(self, key: str) -> bytes:
        """The whole object.

        Raises:
            NotFound: no such key.
        """
        check_key(key)
        with _translated(key):
            return bytes(obstore.get(self._backend, key).bytes())

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """Up to ``length`` bytes from ``start``: fewer at the end of the object.

        Raises:
            NotFound: no such key.
            InvalidOption: nothing stands at ``start``.
        """
        check_key(key)
        if start < 0 or length < 1:
            raise InvalidOption(f"no range of {length} bytes from {start}")
        size = self.size(key)
        if start >= size:
            raise InvalidOption(f"{key} has {size} bytes, none at {start}")
        with _translated(key):
            found = obstore.get_range(self._backend, key, start=start, end=min(start + length, size))
            return bytes(found)

    def download(self, key: str, path: Path) -> str:
        """Writes the object to a file, whole or not at all; returns the sha256 of what was written.

        It asks for chunk after chunk, so that each has its own timeout and retries.

        Raises:
            NotFound: no such key.
        """
        size = self.size(key)
        digest = hashlib.sha256()
        part = path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")
        try:
            with part.open("wb") as file:
                for start in range(0, size, CHUNK_BYTES):
                    with _translated(key):
                        end = min(start + CHUNK_BYTES, size)
                        chunk = obstore.get_range(self._backend, key, start=start, end=end)
                    digest.update(chunk)
                    file.write(chunk)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        return digest.hexdigest()

    def size(self, key: str) -> int:
        """Bytes of an object.

        Raises:
            NotFound: no such key.
        """
        check_key(key)
        with _translated(key):
            return int(obstore.head(self._backend, key)["size"])

    def exists(self, key: str) -> bool:
        try:
            self.size(key)
        except NotFound:
            return False
        return True

    def list(self, prefix: str = "") -> builtins.list[str]:
        """Keys below a folder, at any depth, sorted."""
        return [found.key for found in self.scan(prefix)]

    def scan(self, prefix: str = "") -> builtins.list[StoredObject]:
        """Objects below a folder, at any depth, sorted by key."""
        folder = _check_folder(prefix)
        with _translated(prefix or "/"):
            found = [
                StoredObject(meta["path"], int(meta["size"]), meta["last_modified"])
                for chunk in obstore.list(self._backend, folder or None)
                for meta in chunk
            ]
        return sorted(found, key=lambda item: item.key)

    def folders(self, prefix: str = "") -> builtins.list[str]:
        """Names of the folders directly below a folder, sorted."""
        folder = _check_folder(prefix)
        with _translated(prefix or "/"):
            found = obstore.list_with_delimiter(self._backend, folder or None)["common_prefixes"]
        return sorted(path.rstrip("/").rsplit("/", 1)[-1] for path in found)

    def delete(self, key: str) -> None:
        """Removes an object; one that is not there is no error."""
        check_key(key)
        with suppress(NotFound), _translated(key):
            obstore.delete(self._backend, key)

    def local_path(self, key: str) -> Path | None:
        """The object as a file of a file store, to map in place; None for other stores.

        Raises:
            NotFound: no such key in the file store.
        """
        check_key(key)
        if self._root is None:
            return None
        path = self._root / key
        if not path.is_file():
            raise NotFound(f"no object {key}")
        return path

    def probe(self) -> None:
        """Puts a key twice: every promise of this project rests on the second put losing.

        Raises:
            StoreUnsafe: the second put won.
        """
        key = f"probe/{uuid.uuid4().hex}"
        try:
            first, second = self.put_new(key, b"first"), self.put_new(key, b"second")
            if not first or second or self.get(key) != b"first":
                raise StoreUnsafe(
                    "this store let a create-only put replace an object: two builds could overwrite each "
                    "other. Use one that honours If-None-Match"
                )
        finally:
            with suppress(StoreError):
                self.delete(key)

    def remove_leftovers(self, *, older_than_s: float = 86400.0) -> builtins.list[str]:
        """Removes what killed processes left: probes, and in a directory the parts of puts that never
        ended, which no listing shows. A cloud drops unfinished uploads by a rule of the bucket's own.

        Returns:
            their names.
        """
        cutoff = datetime.now(timezone.utc) - timedelta(seconds=older_than_s)
        removed = [found.key for found in self.scan("probe") if found.last_modified <= cutoff]
        for key in removed:
            self.delete(key)
        if self._root is None:
            return removed
        for path in self._root.rglob("*#*"):
            with suppress(FileNotFoundError):
                if _PART.fullmatch(path.name) and path.stat().st_mtime <= cutoff.timestamp():
                    path.unlink()
                    removed.append(path.relative_to(self._root).as_posix())
        return removed

    def _sync(self, key: str) -> None:
        """Brings an object of a file store to disk, and the entries of the folders that lead to it."""
        if self._root is None:
            return
        path = self._root / key
        _sync_path(path)
        _sync_path(path.parent)
        folder = path.parent
        while folder != self._root and folder not in self._lasting_folders:
            _sync_path(folder.parent)
            self._lasting_folders.add(folder)
            folder = folder.parent


def check_key(key: str) -> str:
    """The key itself when it is a valid one.

    Raises:
        InvalidOption: it is absolute, climbs with '..', or has characters that some store changes.
    """
    if len(key) > _MAX_KEY_CHARS or not all(_SEGMENT.fullmatch(part) for part in key.split("/")):
        raise InvalidOption(f"not an object key: {key[:100]!r}")
    return key


def _check_folder(prefix: str) -> str:
    folder = prefix.rstrip("/")
    return check_key(folder) if folder else ""


def _sync_path(path: Path) -> None:
    with suppress(FileNotFoundError):  # somebody removed it since
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def _translated(key: str, *, writing: bool = False) -> Iterator[None]:
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
        raise StoreError(f"{key}: the store refuses these credentials: {_brief(error)}") from None
    except (exceptions.BaseError, OSError) as error:
        raise StoreUnavailable(f"{key}: {_brief(error)}") from None


def _brief(error: BaseException) -> str:
    """The first line: the rest of obstore's messages is a dump of its structs."""
    return str(error).strip().split("\n", 1)[0][:300]
