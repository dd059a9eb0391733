"""Files on their way into an object store, in parts that come one after the other, over days if need be.

    uploads/<upload_id>/upload.json         what was announced; created once
    uploads/<upload_id>/parts/<offset>      the bytes from there on; created once
    uploads/<upload_id>/whole.json          all of it is there and was checked

Parts are only ever created: two writers that go on from one offset race in one create-only put, and the
loser hears of it. So whoever reaches the store can go on with an upload that another replica began.
"""

from __future__ import annotations

import hashlib
import json
import logging
import re
import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING, Any

from ...errors import ChecksumMismatch, Conflict, NotFound, StoreError, TooLarge, UnreadableRecord
from ...ids import check_upload_id, check_version, is_name
from ...store.json_record import RecordKind, read_record
from ...store.store import Store, StoredObject
from ..catalog import source_key
from .record import UploadRecord

if TYPE_CHECKING:
    from hashlib import _Hash

_log = logging.getLogger(__name__)
PART_BYTES = 16 << 20
MAX_PARTS = 10_000
_DIGESTS_KEPT = 64
_RECORDS_KEPT = 10_000
_PART_NAME = re.compile(r"[0-9]{20}")


@dataclass(frozen=True)
class Upload:
    """How far a file has come.

    Attributes:
        size_bytes: of the whole file, as announced.
        file_name: its ending says how to read it.
        sha256: of the whole file, as announced; None: the sender did not say.
        owner: the caller who announced it; None: a release that did not record callers did.
        parts: their sizes in bytes, in order, without a gap.
        last_modified: when the last of it came.
    """

    upload_id: str
    size_bytes: int
    file_name: str
    sha256: str | None
    owner: str | None
    parts: tuple[int, ...]
    last_modified: datetime

    @property
    def offset(self) -> int:
        """Bytes that are there: where to go on."""
        return sum(self.parts)

    @property
    def complete(self) -> bool:
        return self.offset == self.size_bytes


class Uploads:
    """Uploads in a store. Thread-safe. Every method raises InvalidOption for an id that is none."""

    def __init__(self, store: Store) -> None:
        self._store = store
        # What passed through here is hashed as it passes, or a file would have to be read again for it.
        self._digests: OrderedDict[str, tuple[int, _Hash]] = OrderedDict()
        self._records: OrderedDict[str, UploadRecord] = OrderedDict()  # created once, so never out of date
        self._lock = threading.Lock()

    def create(
        self,
        upload_id: str,
        *,
        size_bytes: int,
        file_name: str,
        sha256: str | None = None,
        owner: str | None = None,
    ) -> None:
        """Announces a file.

        Args:
            owner: the caller whose upload it is.

        Raises:
            Conflict: there is an upload of that id.
        """
        if sha256 is not None:
            check_version(sha256)
        record = UploadRecord(size_bytes, file_name, sha256, owner)
        if not self._store.put_new(f"{_folder(upload_id)}/upload.json", record.to_json()):
            raise Conflict(f"there is an upload {upload_id} already")

    def get(self, upload_id: str) -> Upload:
        """
        Raises:
            NotFound: no such upload: it never was, or was removed.
            UnreadableRecord: what was announced is damaged.
        """
        folder = _folder(upload_id)
        found = self._store.scan(folder)
        try:
            record = self._read(upload_id)
        except NotFound:
            raise NotFound(f"no upload {upload_id}") from None
        return Upload(
            upload_id,
            record.size_bytes,
            record.file_name,
            record.sha256,
            record.owner,
            _parts_in_order(found, f"{folder}/parts/", record.size_bytes),
            max(item.last_modified for item in found) if found else self._store.now(),
        )

    def _read(self, upload_id: str) -> UploadRecord:
        key = f"{_folder(upload_id)}/upload.json"
        return read_record(self._store, key, RecordKind.UPLOAD, UploadRecord.parse)

    def announced(self) -> dict[str, UploadRecord]:
        """Every upload that can be gone on with, by its id. One listing; a record is read once.

        An upload whose record cannot be read is left out: it belongs to nobody, and it expires.
        """
        found = {}
        for upload_id in self.ids():
            record = self._records.get(upload_id)
            if record is None:
                try:
                    record = self._read(upload_id)
                except (NotFound, UnreadableRecord):  # it is being removed; or it is nobody's
                    continue
            found[upload_id] = record
        with self._lock:
            self._records = OrderedDict(list(found.items())[-_RECORDS_KEPT:])
        return found

    def append(self, upload: Upload, data: bytes) -> Upload:
        """The upload with one more part, at most ``PART_BYTES``, at its end.

        Raises:
            TooLarge: more than was announced, or in too many parts.
            Conflict: another writer went on from there.
        """
        offset = upload.offset
        if not data:
            return upload
        if len(data) > PART_BYTES:
            raise TooLarge(f"a part of an upload has at most {PART_BYTES} bytes")
        if offset + len(data) > upload.size_bytes:
            raise TooLarge(f"upload {upload.upload_id} was announced with {upload.size_bytes} bytes")
        if len(upload.parts) >= MAX_PARTS:
            raise TooLarge(f"an upload has at most {MAX_PARTS} parts: send larger ones")
        key = _part_key(upload.upload_id, offset)
        # not won, but the same bytes: the reply to our own put was lost, or both writers send one file
        if not self._store.put_new(key, data):
            self._mend(key, upload.size_bytes - offset, data)
            if self._store.get(key) != data:
                raise Conflict(f"another writer went on with upload {upload.upload_id} from {offset}")
        self._hash(upload.upload_id, offset, data)
        return replace(upload, parts=(*upload.parts, len(data)))

    def finish(self, upload: Upload) -> str:
        """The sha256 of a complete upload, compared with the announced one. Doing it again costs nothing.

        Raises:
            Conflict: it is not complete.
            ChecksumMismatch: the sender announced another sha256. The upload is removed: which of its
                bytes are wrong nobody can tell.
        """
        if not upload.complete:
            raise Conflict(f"upload {upload.upload_id} has {upload.offset} of its {upload.size_bytes} bytes")
        key = f"{_folder(upload.upload_id)}/whole.json"
        try:
            return read_record(self._store, key, RecordKind.UPLOAD_WHOLE, parse_whole)
        except (NotFound, UnreadableRecord):  # the parts say it too
            pass
        sha256 = self._digest(upload)
        if upload.sha256 not in (None, sha256):
            self.remove(upload.upload_id)
            raise ChecksumMismatch(
                f"the file of upload {upload.upload_id} has the sha256 {sha256}, not {upload.sha256}"
            )
        self._store.put(key, json.dumps({"sha256": sha256}).encode())  # equal from whoever puts it
        return sha256

    def keep_as_source(self, upload: Upload, map_id: str, *, build_id: str = "") -> str:
        """Makes one object of the parts, as ``Catalog.put_source`` does of a file; returns its sha256.

        Raises:
            as ``finish``.
            StoreError: the store gives other bytes than it took.
        """
        sha256 = self.finish(upload)
        key = source_key(map_id, sha256, build_id)
        with suppress(NotFound):
            if self._store.size(key) == upload.size_bytes and self._store.sha256(key) == sha256:
                return sha256
        digest = hashlib.sha256()

        def pieces() -> Iterator[bytes]:
            for piece in self._pieces(upload):
                digest.update(piece)
                yield piece
            if digest.hexdigest() != sha256:  # before the object is there
                raise StoreError(f"the store has altered upload {upload.upload_id}")

        self._store.put_pieces(key, pieces())
        return sha256

    def remove(self, upload_id: str) -> None:
        """Removes an upload, at whatever point it is. One that is not there is no error."""
        folder = _folder(upload_id)
        self._store.delete(f"{folder}/upload.json")  # first: without it there is no upload
        for key in self._store.list(folder):
            self._store.delete(key)
        with self._lock:
            self._digests.pop(upload_id, None)

    def ids(self) -> list[str]:
        """Every upload that has left something in the store, sorted."""
        return [name for name in self._store.folders("uploads") if is_name(name)]

    def _mend(self, key: str, left_bytes: int, data: bytes) -> None:
        """Puts the data in place of a part that no ``append`` can have written: it would be in the way for
        ever. Such a part holds nothing that was acknowledged, so replacing it loses nothing."""
        if not _can_be_part(self._store.size(key), left_bytes):
            _log.warning("%s is damaged and is written again", key)
            self._store.put(key, data)

    def _hash(self, upload_id: str, offset: int, data: bytes) -> None:
        with self._lock:
            hashed, digest = self._digests.pop(upload_id, (0, hashlib.sha256()))
            if hashed != offset:  # a part of it came another way
                return
            digest.update(data)
            self._digests[upload_id] = (offset + len(data), digest)
            while len(self._digests) > _DIGESTS_KEPT:
                self._digests.popitem(last=False)

    def _digest(self, upload: Upload) -> str:
        with self._lock:
            hashed, digest = self._digests.get(upload.upload_id, (0, hashlib.sha256()))
        if hashed != upload.size_bytes:
            digest = hashlib.sha256()
            for piece in self._pieces(upload):
                digest.update(piece)
        return digest.hexdigest()

    def _pieces(self, upload: Upload) -> Iterator[bytes]:
        offset = 0
        for size in upload.parts:
            yield self._store.get(_part_key(upload.upload_id, offset))
            offset += size


def parse_whole(record: dict[str, Any]) -> str:
    """The sha256 of a whole upload.

    Raises:
        KeyError, TypeError, InvalidOption: it says none.
    """
    return check_version(record["sha256"])


def _folder(upload_id: str) -> str:
    return f"uploads/{check_upload_id(upload_id)}"


def _parts_in_order(found: Iterable[StoredObject], prefix: str, size_bytes: int) -> tuple[int, ...]:
    """Sizes of the parts without a gap from the start, of what a listing shows.

    A listing is not to be trusted: it can hold names that are no offsets, and parts that are empty (a power
    cut took their bytes), overlap, or go beyond the announced size. The first of those ends the parts.
    """
    sizes = {
        int(name): item.size_bytes
        for item in found
        if item.key.startswith(prefix) and _PART_NAME.fullmatch(name := item.key.removeprefix(prefix))
    }
    parts: list[int] = []
    offset = 0
    while len(parts) < MAX_PARTS and _can_be_part(sizes.get(offset, 0), size_bytes - offset):
        parts.append(sizes[offset])
        offset += sizes[offset]
    return tuple(parts)


def _can_be_part(size_bytes: int, left_bytes: int) -> bool:
    """Whether ``append`` can have written a part of that size where so many bytes were left to come."""
    return 0 < size_bytes <= min(PART_BYTES, left_bytes)


def _part_key(upload_id: str, offset: int) -> str:
    return f"{_folder(upload_id)}/parts/{offset:020d}"
