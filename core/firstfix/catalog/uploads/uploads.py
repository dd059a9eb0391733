"""Uploads: large files that arrive in parts, one after the other, over days if need be.

    uploads/<upload_id>/upload.json         the announcement; created once
    uploads/<upload_id>/parts/<offset>      the bytes from this offset; created once
    uploads/<upload_id>/whole.json          every part is there and was checked

Parts are only ever created. Two writers that continue from one offset race in one create-only put, and the
loser sees that it lost. So any process that reaches the store can continue an upload that another replica
began.

A removal deletes the announcement first. Whoever puts another object looks for the announcement afterwards,
and takes the object back where it is gone. So nothing is left that no quota counts. A folder without an
announcement is left from a process that was killed, and whoever sees it removes it.
"""

from __future__ import annotations

import hashlib
import logging
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime

from ...errors import ChecksumMismatch, Conflict, NotFound, StoreError, TooLarge, UnreadableRecord
from ...ids import check_version, is_name
from ...store.json_record import RecordKind, read_record, record_json
from ...store.store import Store
from ..sources import source_key
from .parts import can_be_part, check_part_limits, part_key, parts_in_order, upload_folder
from .record import UploadRecord, parse_whole
from .running_digests import RunningDigests

_log = logging.getLogger(__name__)
_RECORDS_KEPT = 10_000
SWEPT_AT_ONCE = 100  # leftovers of removed uploads: a caller who begins one does not wait for more of them


@dataclass(frozen=True)
class Upload:
    """State of an upload.

    Attributes:
        size_bytes: announced size of the whole file.
        file_name: its ending tells the format.
        sha256: announced sha256 of the whole file; None if the sender did not give it.
        owner: caller who announced it; None if the record is from a release without callers.
        parts: sizes of the parts in bytes, in order, without a gap.
        last_modified: time of the last put.
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
        """Number of bytes received, where the next part begins."""
        return sum(self.parts)

    @property
    def complete(self) -> bool:
        """True once all bytes are there."""
        return self.offset == self.size_bytes


class Uploads:
    """Uploads in a store. Thread-safe. Every method raises InvalidOption for an invalid id."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._digests = RunningDigests()
        self._records: OrderedDict[str, UploadRecord] = OrderedDict()  # created once, so never outdated
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
        """Announce a file.

        Args:
            owner: caller who owns the upload.

        Raises:
            Conflict: an upload has this id already.
        """
        if sha256 is not None:
            check_version(sha256)
        record = UploadRecord(size_bytes, file_name, sha256, owner)
        if not self._store.put_new(f"{upload_folder(upload_id)}/upload.json", record.to_json()):
            raise Conflict(f"an upload {upload_id} exists already")

    def get(self, upload_id: str) -> Upload:
        """State of an upload.

        Raises:
            NotFound: no such upload, or it was removed.
            UnreadableRecord: its announcement is damaged.
        """
        folder = upload_folder(upload_id)
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
            parts_in_order(found, upload_id, record.size_bytes),
            max(item.last_modified for item in found) if found else self._store.now(),
        )

    def _read(self, upload_id: str) -> UploadRecord:
        key = f"{upload_folder(upload_id)}/upload.json"
        return read_record(self._store, key, RecordKind.UPLOAD, UploadRecord.parse)

    def announced(self) -> dict[str, UploadRecord]:
        """Announcements of all uploads that can be continued, by id. One listing; a record is read once.

        An upload with a damaged record is left out: it has no owner, and expires. Some objects without an
        announcement are removed.
        """
        found = {}
        to_sweep = SWEPT_AT_ONCE
        for upload_id in self.ids():
            record = self._records.get(upload_id)
            if record is None:
                try:
                    record = self._read(upload_id)
                except NotFound:
                    to_sweep -= self._sweep(upload_id, to_sweep)
                    continue
                except UnreadableRecord:
                    continue
            found[upload_id] = record
        with self._lock:
            self._records = OrderedDict(list(found.items())[-_RECORDS_KEPT:])
        return found

    def append(self, upload: Upload, data: bytes) -> Upload:
        """Put one more part, of at most ``PART_BYTES``, at the end. Returns the new state of the upload.

        Raises:
            TooLarge: more bytes than announced, or too many parts.
            Conflict: another writer continued from this offset.
            NotFound: the upload was removed meanwhile.
        """
        offset = upload.offset
        if not data:
            return upload
        if offset + len(data) > upload.size_bytes:
            raise TooLarge(f"upload {upload.upload_id} was announced with {upload.size_bytes} bytes")
        check_part_limits(len(data), count=len(upload.parts) + 1)
        key = part_key(upload.upload_id, offset)
        # lost but equal bytes: the reply to our own put was lost, or both writers send the same file
        if not self._store.put_new(key, data):
            self._repair_part(key, upload.size_bytes - offset, data)
            if self._store.get(key) != data:
                raise Conflict(f"another writer continued upload {upload.upload_id} from {offset}")
        self._take_back_if_removed(upload.upload_id, key)
        self._digests.update(upload.upload_id, offset, data)
        return replace(upload, parts=(*upload.parts, len(data)))

    def finish(self, upload: Upload) -> str:
        """Compare the sha256 of a complete upload with the announced one, and return it. Cheap to repeat.

        Raises:
            Conflict: the upload is not complete.
            ChecksumMismatch: the sender announced another sha256. The upload is removed, because nobody can
                tell which of its bytes are wrong.
            NotFound: the upload was removed meanwhile.
        """
        if not upload.complete:
            raise Conflict(f"upload {upload.upload_id} has {upload.offset} of its {upload.size_bytes} bytes")
        key = f"{upload_folder(upload.upload_id)}/whole.json"
        try:
            return read_record(self._store, key, RecordKind.UPLOAD_WHOLE, parse_whole)
        except (NotFound, UnreadableRecord):  # the parts tell it too
            pass
        sha256 = self._sha256(upload)
        if upload.sha256 not in (None, sha256):
            self.remove(upload.upload_id)
            raise ChecksumMismatch(
                f"the file of upload {upload.upload_id} has the sha256 {sha256}, not {upload.sha256}"
            )
        self._store.put(key, record_json({"sha256": sha256}))  # every writer puts the same content
        self._take_back_if_removed(upload.upload_id, key)
        return sha256

    def keep_as_source(self, upload: Upload, map_id: str, *, build_id: str = "") -> str:
        """Join the parts to a source of a map, and return its sha256.

        Args:
            build_id: put the source as this build's own copy.

        Raises:
            Conflict, ChecksumMismatch: see ``finish``.
            StoreError: the store returns other bytes than it was given.
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
            if digest.hexdigest() != sha256:  # before the object exists
                raise StoreError(f"the store returned other bytes than upload {upload.upload_id} had")

        self._store.put_pieces(key, pieces())
        return sha256

    def remove(self, upload_id: str) -> None:
        """Remove an upload, complete or not. A missing upload is no error."""
        self._store.delete(f"{upload_folder(upload_id)}/upload.json")  # first: without it there is no upload
        self._sweep(upload_id)
        self._digests.drop(upload_id)

    def ids(self) -> list[str]:
        """Ids of all uploads with anything in the store, sorted."""
        return [name for name in self._store.folders("uploads") if is_name(name)]

    def _sweep(self, upload_id: str, most: int | None = None) -> int:
        """Remove objects of an upload that has no announcement. Returns their number."""
        left = self._store.list(upload_folder(upload_id))[:most]
        for key in left:
            self._store.delete(key)
        return len(left)

    def _take_back_if_removed(self, upload_id: str, key: str) -> None:
        """Remove an object that was just put, if the upload was removed before the put.

        A later removal lists the object.
        """
        if not self._store.exists(f"{upload_folder(upload_id)}/upload.json"):
            self._store.delete(key)
            raise NotFound(f"no upload {upload_id}: it was removed meanwhile")

    def _repair_part(self, key: str, left_bytes: int, data: bytes) -> None:
        """Replace a part that no ``append`` can have written: it would block the upload for ever.

        Such a part contains nothing that was acknowledged, so replacing it loses nothing.
        """
        if not can_be_part(self._store.size(key), left_bytes):
            _log.warning("%s is damaged and is written again", key)
            self._store.put(key, data)

    def _sha256(self, upload: Upload) -> str:
        sha256 = self._digests.get(upload.upload_id, upload.size_bytes)
        if sha256 is not None:
            return sha256
        digest = hashlib.sha256()
        for piece in self._pieces(upload):
            digest.update(piece)
        return digest.hexdigest()

    def _pieces(self, upload: Upload) -> Iterator[bytes]:
        offset = 0
        for size in upload.parts:
            yield self._store.get(part_key(upload.upload_id, offset))
            offset += size
