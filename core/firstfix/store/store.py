"""The one door to object storage: files, memory, S3, Google and Azure behind a dozen calls.

Correctness stands on create-only puts alone, never on rename or compare-and-swap: they work on every
store. ``probe`` finds out a store that only pretends to have them. What is put is durable when the
call returns, also in a directory, where it gets its name only after its bytes are on disk.
"""

from __future__ import annotations

import builtins
import hashlib
import uuid
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import obstore
from obstore import exceptions

from ..errors import InvalidOption, NotFound, ReadOnly, StoreError, StoreUnsafe, TooLarge
from .backend import open_backend, translated
from .durable_files import DurableFiles
from .json_record import UnreadableRecords
from .object_keys import check_folder, check_key
from .sha256 import sha256_of
from .url import StoreUrl

CHUNK_BYTES = 16 << 20
_READ_BYTES = 1 << 20


@dataclass(frozen=True)
class StoredObject:
    """One object as a listing shows it.

    Attributes:
        e_tag: another one once the object was put again; empty where the store has none.
    """

    key: str
    size_bytes: int
    last_modified: datetime
    e_tag: str = ""


class Store:
    """Objects by key. Thread-safe.

    Keys are segments of letters, digits, ``.``, ``_`` and ``-`` joined by ``/``; a segment does not
    start with a dot. Every method raises InvalidOption on another key, StoreUnavailable when the
    store does not answer, StoreError when it refuses; those that write raise ReadOnly when the store
    was opened so.

    Attributes:
        unreadable: the records in it that could not be read.
    """

    def __init__(self, backend: Any, *, root: Path | None = None, read_only: bool = False) -> None:
        self._backend = backend
        self._root = root  # the directory of a file store
        self._files = None if root is None else DurableFiles(root)
        self._read_only = read_only
        self.unreadable = UnreadableRecords()

    @classmethod
    def open(cls, url: str, *, read_only: bool = False) -> Store:
        """The store at a URL (forms: ``firstfix.store.url``). Nothing is asked of it yet.

        Raises:
            InvalidOption: the URL is of no known form, or a cloud's settings are incomplete.
        """
        return cls.open_at(StoreUrl.parse(url), read_only=read_only)

    @classmethod
    def open_at(cls, where: StoreUrl, *, read_only: bool = False) -> Store:
        """As ``open``, of a URL that was parsed before."""
        root = Path(where.prefix) if where.scheme == "file" else None
        return cls(open_backend(where, make_directory=not read_only), root=root, read_only=read_only)

    def put_new(self, key: str, data: bytes | Path) -> bool:
        """Create-only put, atomic. False when the key exists already: of many at once one wins.

        A lost reply can make the winner see False, as its retry meets its own object: whoever must
        know compares the content. A file is read into memory; for large ones see ``upload``.
        """
        self._writing(key)
        if self._files is not None:
            with translated(key, writing=True), _pieces(data) as pieces:
                return self._files.create(key, pieces)
        try:
            with translated(key, writing=True):
                obstore.put(self._backend, key, data, mode="create")
        except (exceptions.AlreadyExistsError, exceptions.PreconditionError):
            return False
        except exceptions.NotSupportedError:
            raise StoreUnsafe("this store has no create-only put") from None
        return True

    def put(self, key: str, data: bytes) -> None:
        """Atomic put that replaces what was there."""
        self._writing(key)
        self._replace(key, data)

    def upload(self, key: str, path: Path) -> bool:
        """Puts a file under a key that names its content: for such keys the last of two equal puts
        does no harm. Streams. False when the same content is there already and nothing was sent.

        An object of the same size is read and compared by its sha256, and replaced where it differs: what
        a fault altered is mended by putting it again. Reading costs little, as few objects are there
        already; a checksum that the store keeps may be of the damaged bytes, or none of the content.
        """
        self._writing(key)
        with suppress(NotFound):
            if self.size(key) == path.stat().st_size and self.sha256(key) == sha256_of(path):
                if self._files is not None:
                    self._files.sync_name(key)
                return False
        self._replace(key, path)
        return True

    def put_pieces(self, key: str, pieces: Iterable[bytes]) -> None:
        """Puts one object from its pieces, a few of which are in memory at a time. Where a piece cannot be
        had the error leaves, and there is no object: so it can be checked as it passes."""
        self._writing(key)
        if self._files is not None:
            with translated(key, writing=True):
                self._files.replace(key, pieces)
            return
        source = iter(pieces)
        with ThreadPoolExecutor(1, thread_name_prefix="pieces") as other:

            def made() -> Iterator[bytes]:
                # obstore asks from within its event loop, where a piece's maker could not call obstore
                while (piece := other.submit(next, source, None).result()) is not None:
                    yield piece

            with translated(key, writing=True):
                obstore.put(self._backend, key, made(), chunk_size=CHUNK_BYTES, max_concurrency=2)

    def get(self, key: str, *, max_bytes: int | None = None) -> bytes:
        """The whole object.

        Args:
            max_bytes: nothing is read of a larger one.

        Raises:
            NotFound: no such key.
            TooLarge: it has more than ``max_bytes``.
        """
        check_key(key)
        with translated(key):
            found = obstore.get(self._backend, key)
            size = int(found.meta["size"])
            if max_bytes is not None and size > max_bytes:
                raise TooLarge(f"{key} has {size} bytes, the limit is {max_bytes}")
            return bytes(found.bytes())

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
        with translated(key):
            found = obstore.get_range(self._backend, key, start=start, end=min(start + length, size))
            return bytes(found)

    def download(self, key: str, path: Path, told: Callable[[float], None] = lambda done: None) -> str:
        """Writes the object to a file, whole or not at all; returns the sha256 of what was written.

        It asks for chunk after chunk, so that each has its own timeout and retries.

        Args:
            told: called after each chunk with the share that is done, 0..1.

        Raises:
            NotFound: no such key.
        """
        digest = hashlib.sha256()
        part = path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")
        try:
            with part.open("wb") as file:
                size = self.size(key)
                for piece in self.pieces(key):
                    digest.update(piece)
                    file.write(piece)
                    told(file.tell() / size)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        return digest.hexdigest()

    def pieces(self, key: str) -> Iterator[bytes]:
        """The object, chunk after chunk, of which each has its own timeout and retries.

        Raises:
            NotFound: no such key.
        """
        size = self.size(key)
        for start in range(0, size, CHUNK_BYTES):
            yield self.get_range(key, start, CHUNK_BYTES)

    def sha256(self, key: str) -> str:
        """Hex digest of the object, which is read for it.

        Raises:
            NotFound: no such key.
        """
        digest = hashlib.sha256()
        for piece in self.pieces(key):
            digest.update(piece)
        return digest.hexdigest()

    def size(self, key: str) -> int:
        """Bytes of an object.

        Raises:
            NotFound: no such key.
        """
        check_key(key)
        with translated(key):
            return int(obstore.head(self._backend, key)["size"])

    def exists(self, key: str) -> bool:
        try:
            self.size(key)
        except NotFound:
            return False
        return True

    def list(self, prefix: str = "", *, after: str | None = None) -> builtins.list[str]:
        """Keys below a folder, at any depth, sorted; only those that sort after a key, if one is given."""
        return [found.key for found in self.scan(prefix, after=after)]

    def scan(self, prefix: str = "", *, after: str | None = None) -> builtins.list[StoredObject]:
        """Objects below a folder, at any depth, sorted by key; only those after a key, if one is given."""
        folder = check_folder(prefix)
        with translated(prefix or "/"):
            found = [
                StoredObject(meta["path"], int(meta["size"]), meta["last_modified"], meta["e_tag"] or "")
                for chunk in obstore.list(self._backend, folder or None, offset=after)
                for meta in chunk
            ]
        # some stores take the key for no more than a hint
        return sorted((f for f in found if after is None or f.key > after), key=lambda item: item.key)

    def folders(self, prefix: str = "") -> builtins.list[str]:
        """Names of the folders directly below a folder, sorted."""
        folder = check_folder(prefix)
        with translated(prefix or "/"):
            found = obstore.list_with_delimiter(self._backend, folder or None)["common_prefixes"]
        return sorted(path.rstrip("/").rsplit("/", 1)[-1] for path in found)

    def delete(self, key: str) -> None:
        """Removes an object; one that is not there is no error. In a file store the folders go that it
        leaves empty, but the uppermost: other stores have none."""
        self._writing(key)
        with suppress(NotFound), translated(key):
            obstore.delete(self._backend, key)
        if self._files is not None:
            with translated(key, writing=True):
                self._files.removed(key)

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

    @property
    def directory(self) -> Path | None:
        """Directory of a file store; None for other stores, which do not tell how much room they have."""
        return self._root

    def probe(self) -> None:
        """Puts a key twice: every promise of this project rests on the second put losing. A read-only
        store, which rests on nothing, is only looked into.

        Raises:
            StoreUnsafe: the second put won.
        """
        if self._read_only:
            self.folders()
            return
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

    def now(self) -> datetime:
        """The store's own time: of an object that is put just now. The age of an object is the difference
        of two such times, so that a wrong clock on this machine makes nothing old."""
        while True:
            key = f"probe/{uuid.uuid4().hex}"
            self.put(key, b"now")
            try:
                with suppress(NotFound), translated(key):  # somebody removes leftovers of any age
                    modified: datetime = obstore.head(self._backend, key)["last_modified"]
                    return modified
            finally:
                self.delete(key)

    def remove_leftovers(self, *, older_than_s: float = 86400.0, dry_run: bool = False) -> builtins.list[str]:
        """Removes what killed processes left: probes, and in a directory the parts of puts that never
        ended, which no listing shows. A cloud drops unfinished uploads by a rule of the bucket's own.

        Returns:
            their names, of a dry run too, which leaves them.
        """
        cutoff = self.now() - timedelta(seconds=older_than_s)
        probes = [found.key for found in self.scan("probe") if found.last_modified <= cutoff]
        if not dry_run:
            for key in probes:
                self.delete(key)
        return probes if self._files is None else probes + self._files.remove_parts(cutoff, dry_run=dry_run)

    def _writing(self, key: str) -> None:
        check_key(key)
        if self._read_only:
            raise ReadOnly(f"{key}: this store was opened for reading only")

    def _replace(self, key: str, data: bytes | Path) -> None:
        with translated(key, writing=True):
            if self._files is None:
                obstore.put(self._backend, key, data)
            else:
                with _pieces(data) as pieces:
                    self._files.replace(key, pieces)


@contextmanager
def _pieces(data: bytes | Path) -> Iterator[Iterable[bytes]]:
    """Bytes as they are, a file a few at a time."""
    if isinstance(data, bytes):
        yield (data,)
    else:
        with data.open("rb") as file:
            yield iter(lambda: file.read(_READ_BYTES), b"")
