"""The one interface to object storage: files, memory, S3, Google and Azure behind a dozen calls.

Correctness rests on create-only puts alone, never on rename or compare-and-swap, because every store has
them. ``Store.probe`` detects a store that only pretends to. An object is durable when its put returns. In a
directory too: a file gets its name only after its bytes are on disk, unless the directory is a cache.
"""

from __future__ import annotations

import builtins
import hashlib
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import obstore

from ..errors import InvalidOption, NotFound, ReadOnly, StoreError, StoreUnavailable, StoreUnsafe, TooLarge
from .backend import BucketWriter, open_backend, translated
from .object_keys import check_folder, check_key
from .sha256 import sha256_of
from .unreadable_records import UnreadableRecords
from .url import StoreUrl
from .writer import DirectoryWriter, Writer

CHUNK_BYTES = 16 << 20
NO_CREATE = "two builds could overwrite each other. Use one that honours If-None-Match"


@dataclass(frozen=True)
class StoredObject:
    """One object of a listing.

    Attributes:
        e_tag: changes each time the object is put; empty if the store has none.
    """

    key: str
    size_bytes: int
    last_modified: datetime
    e_tag: str = ""


class Store:
    """Objects by key. Thread-safe.

    A key is segments of letters, digits, ``.``, ``_`` and ``-``, joined by ``/``. A segment does not start
    with a dot. Every method raises InvalidOption for another key, StoreUnavailable if the store does not
    answer, and StoreError if it refuses. Methods that write raise ReadOnly on a store opened for reading.

    Attributes:
        unreadable: records of this store that could not be read.
    """

    def __init__(
        self, backend: Any, *, root: Path | None = None, read_only: bool = False, is_cache: bool = False
    ) -> None:
        self._backend = backend
        self._root = root  # the directory of a file store
        bucket = BucketWriter(backend)
        self._writer: Writer = bucket if root is None else DirectoryWriter(bucket, root, is_cache=is_cache)
        self._read_only = read_only
        self.unreadable = UnreadableRecords()

    @classmethod
    def open(cls, url: str, *, read_only: bool = False) -> Store:
        """Open the store at a URL (forms: ``firstfix.store.url``). Sends no request yet.

        Raises:
            InvalidOption: the URL has no known form, or a cloud's settings are incomplete.
        """
        return cls.open_at(StoreUrl.parse(url), read_only=read_only)

    @classmethod
    def open_cache(cls, folder: Path) -> Store:
        """Open a directory of objects that their readers check, and make again where they are gone.

        A put does not wait for the disk: a power cut may leave an object of it torn, or none.

        Raises:
            StoreUnavailable: the directory cannot be made.
        """
        where = StoreUrl.parse(str(folder))
        return cls(open_backend(where), root=Path(where.prefix), is_cache=True)

    @classmethod
    def open_at(cls, where: StoreUrl, *, read_only: bool = False) -> Store:
        """Open the store at a parsed URL, like ``open``."""
        root = Path(where.prefix) if where.scheme == "file" else None
        return cls(open_backend(where, make_directory=not read_only), root=root, read_only=read_only)

    def put_new(self, key: str, data: bytes | Path) -> bool:
        """Put an object only if the key is new, atomically. Returns False if the key exists.

        Of many writers at once, one wins. If the reply to the winner is lost, its retry meets its own object
        and the winner sees False too: a caller that must know compares the content. A file is read into
        memory; ``put_file`` streams large ones.
        """
        self._check_writable(key)
        return self._writer.create(key, data)

    def put(self, key: str, data: bytes) -> None:
        """Put an object atomically, in place of the one that may be there."""
        self._check_writable(key)
        self._writer.replace(key, data)

    def put_file(self, key: str, path: Path) -> bool:
        """Put a file under a key that names its content. Streams. Returns False if nothing had to be sent.

        An object of the same size is read and compared by its sha256, and replaced if it differs: putting an
        object again repairs it. This costs little, because few objects exist already. The store's own
        checksum is not enough: it may be of the damaged bytes.
        """
        self._check_writable(key)
        with suppress(NotFound):
            if self.size(key) == path.stat().st_size and self.sha256(key) == sha256_of(path):
                self._writer.make_durable(key)
                return False
        self._writer.replace(key, path)
        return True

    def check_room(self, size_bytes: int, what: str) -> None:
        """Check that the store has room for large objects. A cloud is taken to have it.

        Args:
            what: is to be put, for the message.

        Raises:
            OutOfSpace: the disk has less than these bytes, and some for records.
        """
        self._writer.check_room(size_bytes, what)

    def put_pieces(self, key: str, pieces: Iterable[bytes]) -> None:
        """Put one object from its pieces, with a few of them in memory at a time.

        If a piece raises, the error passes on and no object is written: so content can be checked on the way.
        """
        self._check_writable(key)
        self._writer.replace_from_pieces(key, pieces)

    def get(self, key: str, *, max_bytes: int | None = None) -> bytes:
        """Read a whole object.

        Args:
            max_bytes: a larger object is not read.

        Raises:
            NotFound: no such key.
            TooLarge: the object has more than ``max_bytes``.
        """
        check_key(key)
        with translated(key):
            found = obstore.get(self._backend, key)
            size = int(found.meta["size"])
            if max_bytes is not None and size > max_bytes:
                raise TooLarge(f"{key} has {size} bytes, the limit is {max_bytes}")
            return bytes(found.bytes())

    def get_range(self, key: str, start: int, length: int, *, size: int | None = None) -> bytes:
        """Read up to ``length`` bytes from ``start``, fewer at the end of the object.

        Args:
            size: of the object; None: the store is asked.

        Raises:
            NotFound: no such key.
            InvalidOption: ``start`` is beyond the end.
        """
        check_key(key)
        if start < 0 or length < 1:
            raise InvalidOption(f"no range of {length} bytes from {start}")
        if size is None:
            size = self.size(key)
        if start >= size:
            raise InvalidOption(f"{key} has {size} bytes, none at {start}")
        with translated(key):
            found = obstore.get_range(self._backend, key, start=start, end=min(start + length, size))
            return bytes(found)

    def download(self, key: str, path: Path, on_progress: Callable[[float], None] = lambda done: None) -> str:
        """Write an object to a file, whole or not at all. Returns the sha256 of the written bytes.

        Args:
            on_progress: called after each chunk with the share that is done, 0..1.

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
                    on_progress(file.tell() / size)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        return digest.hexdigest()

    def pieces(self, key: str) -> Iterator[bytes]:
        """Read an object chunk by chunk. Each chunk has its own timeout and retries.

        Raises:
            NotFound: no such key.
        """
        size = self.size(key)
        for start in range(0, size, CHUNK_BYTES):
            yield self.get_range(key, start, CHUNK_BYTES)

    def sha256(self, key: str) -> str:
        """Read an object and return its sha256 as hex.

        Raises:
            NotFound: no such key.
        """
        digest = hashlib.sha256()
        for piece in self.pieces(key):
            digest.update(piece)
        return digest.hexdigest()

    def size(self, key: str) -> int:
        """Size of an object in bytes.

        Raises:
            NotFound: no such key.
        """
        check_key(key)
        with translated(key):
            return int(obstore.head(self._backend, key)["size"])

    def last_modified(self, key: str) -> datetime:
        """When an object was last put, by the store's clock.

        Raises:
            NotFound: no such key.
        """
        check_key(key)
        with translated(key):
            found: datetime = obstore.head(self._backend, key)["last_modified"]
            return found

    def exists(self, key: str) -> bool:
        """Whether there is an object under the key."""
        try:
            self.size(key)
        except NotFound:
            return False
        return True

    def list(self, prefix: str = "", *, after: str | None = None) -> builtins.list[str]:
        """Keys below a folder at any depth, sorted. With ``after`` only keys that sort after it."""
        return [found.key for found in self.scan(prefix, after=after)]

    def scan(self, prefix: str = "", *, after: str | None = None) -> builtins.list[StoredObject]:
        """Objects below a folder at any depth, sorted by key. With ``after`` only keys that sort after it."""
        folder = check_folder(prefix)
        with translated(prefix or "/"):
            found = [
                StoredObject(meta["path"], int(meta["size"]), meta["last_modified"], meta["e_tag"] or "")
                for chunk in obstore.list(self._backend, folder or None, offset=after)
                for meta in chunk
            ]
        # some stores take ``after`` only as a hint
        return sorted((f for f in found if after is None or f.key > after), key=lambda item: item.key)

    def folders(self, prefix: str = "") -> builtins.list[str]:
        """Names of the folders directly below a folder, sorted."""
        folder = check_folder(prefix)
        with translated(prefix or "/"):
            found = obstore.list_with_delimiter(self._backend, folder or None)["common_prefixes"]
        return sorted(path.rstrip("/").rsplit("/", 1)[-1] for path in found)

    def delete(self, key: str) -> None:
        """Remove an object. A missing object is no error.

        A file store also removes the folders that this leaves empty, except the uppermost: other stores have
        no folders.
        """
        self._check_writable(key)
        self._writer.delete(key)

    def local_path(self, key: str) -> Path | None:
        """Path of an object in a file store, for mapping it in place. None for other stores.

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
        """Directory of a file store. None for other stores, which do not say how much space they have."""
        return self._root

    def probe(self) -> None:
        """Check that the second of two create-only puts loses: the whole project relies on this.

        A read-only store relies on nothing; it is only listed.

        Raises:
            StoreUnsafe: the second put won, or the store has no such puts.
        """
        if self._read_only:
            self.folders()
            return
        key = f"probe/{uuid.uuid4().hex}"
        try:
            self.put_new(key, b"first")
            if self.put_new(key, b"second"):
                raise StoreUnsafe(f"this store let a create-only put replace an object: {NO_CREATE}")
            if not self._has(key, b"first"):
                raise StoreUnsafe(f"a create-only put made no object, or another one: {NO_CREATE}")
        except StoreUnavailable as error:
            if self._fails_to_create_alone():
                raise StoreUnsafe(f"this store refuses create-only puts: {NO_CREATE} ({error})") from None
            raise
        finally:
            with suppress(StoreError):
                self.delete(key)

    def _has(self, key: str, content: bytes) -> bool:
        try:
            return self.get(key) == content
        except NotFound:
            return False

    def _fails_to_create_alone(self) -> bool:
        """Whether the store takes a put, and create-only puts fail before and after it."""
        key = f"probe/{uuid.uuid4().hex}"
        try:
            self.put(key, b"any")
            try:
                self.put_new(key, b"first")  # it exists: where such puts work, this one loses
            except StoreUnavailable:
                return True
        except StoreError:
            pass
        finally:
            with suppress(StoreError):
                self.delete(key)
        return False

    def now(self) -> datetime:
        """Current time of the store's clock, read from an object put just now.

        The age of an object is a difference of two such times, so a wrong clock on this machine does not
        make objects old.
        """
        while True:
            key = f"probe/{uuid.uuid4().hex}"
            self.put(key, b"now")
            try:
                with suppress(NotFound), translated(key):  # another process may remove leftovers of any age
                    modified: datetime = obstore.head(self._backend, key)["last_modified"]
                    return modified
            finally:
                self.delete(key)

    def remove_leftovers(self, *, older_than_s: float = 86400.0, dry_run: bool = False) -> builtins.list[str]:
        """Remove what killed processes left: probes and, in a directory, parts of puts that never ended.

        Listings do not show those parts. A cloud removes unfinished puts by a rule of the bucket.

        Returns:
            Names of what was removed, or with ``dry_run`` would be.
        """
        cutoff = self.now() - timedelta(seconds=older_than_s)
        probes = [found.key for found in self.scan("probe") if found.last_modified <= cutoff]
        if not dry_run:
            for key in probes:
                self.delete(key)
        return probes + self._writer.remove_parts(cutoff, dry_run=dry_run)

    def _check_writable(self, key: str) -> None:
        check_key(key)
        if self._read_only:
            raise ReadOnly(f"{key}: this store was opened for reading only")
