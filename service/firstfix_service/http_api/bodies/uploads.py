"""Resumable uploads: quotas of open ones, and bodies of which is stored what has arrived."""

from __future__ import annotations

import threading

from fastapi import Request
from starlette.requests import ClientDisconnect

from firstfix.catalog.uploads.parts import PART_BYTES
from firstfix.catalog.uploads.record import UploadRecord
from firstfix.catalog.uploads.uploads import Upload, Uploads
from firstfix.errors import DeadlineExceeded, NotFound, Overloaded, QuotaExceeded, TooLarge

from ...auth.principal import Principal
from ...limits.disk_space import Reservation
from ...limits.limits import Limits
from ...thread_pools import COPIES
from .request_body import Pace, paced_pieces
from .tus import Checksum


class UploadQuota:
    """Limits of open uploads. Thread-safe.

    Several replicas that begin uploads of one caller at the same moment may each let one pass.
    """

    def __init__(self, uploads: Uploads, limits: Limits) -> None:
        self._uploads = uploads
        self._max_open, self._max_open_per_caller = (
            limits.max_open_uploads,
            limits.max_open_uploads_per_caller,
        )
        self._max_bytes_per_caller = limits.largest_files_per_caller * limits.max_upload_bytes
        self._beginning: dict[str, UploadRecord] = {}
        self._lock = threading.Lock()

    def begin(
        self, owner: str, upload_id: str, *, size_bytes: int, file_name: str, sha256: str | None
    ) -> None:
        """Create an upload within the quotas.

        Raises:
            QuotaExceeded: the caller has reached its quota.
            Overloaded: all callers together have too many.
        """
        wanted = UploadRecord(size_bytes, file_name, sha256, owner)
        with self._lock:  # not held during requests to the store
            self._beginning[upload_id] = wanted
            beginning = dict(self._beginning)
        try:
            self._check(owner, {**self._uploads.announced(), **beginning})
            self._uploads.create(
                upload_id, size_bytes=size_bytes, file_name=file_name, sha256=sha256, owner=owner
            )
        finally:
            with self._lock:
                del self._beginning[upload_id]

    def _check(self, owner: str, records: dict[str, UploadRecord]) -> None:
        sizes = [record.size_bytes for record in records.values() if record.owner == owner]
        if len(sizes) > self._max_open_per_caller:
            raise QuotaExceeded(
                f"{self._max_open_per_caller} uploads of this caller are open: remove some with DELETE"
            )
        if sum(sizes) > self._max_bytes_per_caller:
            raise QuotaExceeded(
                f"the open uploads of one caller have at most {self._max_bytes_per_caller} bytes together: "
                "remove some with DELETE"
            )
        if len(records) > self._max_open:
            raise Overloaded(f"{self._max_open} uploads are open: try again")


def own_upload(uploads: Uploads, caller: Principal, upload_id: str) -> Upload:
    """An upload of this caller.

    Raises:
        NotFound: no such upload, or another caller's: the caller cannot tell which.
        StoreError: the store failed.
    """
    upload = uploads.get(upload_id)
    if not caller.owns(upload.owner):
        raise NotFound(f"no upload {upload_id}")
    return upload


async def append_body(
    uploads: Uploads,
    upload: Upload,
    request: Request,
    checksum: Checksum | None,
    pace: Pace,
    room: Reservation,
) -> Upload:
    """Append a request's body to an upload, and return the upload.

    One part of the body is in memory at a time. If the connection breaks or is too slow, the bytes that have
    arrived are stored; those of a body with a checksum are not.

    Raises:
        TooLarge: more bytes than announced, or a body with a checksum that has more than one part.
        ChecksumMismatch: nothing of the body is stored.
        Conflict: another request writes to this upload.
        DeadlineExceeded: the body is too slow.
        OutOfSpace: the store's disk is full.
    """
    waiting = bytearray()
    broken: BaseException | None = None
    try:
        async for piece in paced_pieces(request, pace):
            waiting += piece
            if upload.offset + len(waiting) > upload.size_bytes:
                raise TooLarge(f"the upload was announced with {upload.size_bytes} bytes")
            if checksum is not None and len(waiting) > PART_BYTES:
                raise TooLarge(f"a body with a checksum has at most {PART_BYTES} bytes")
            while checksum is None and len(waiting) >= PART_BYTES:
                upload = await _append(uploads, upload, waiting[:PART_BYTES], room)
                del waiting[:PART_BYTES]
    except (ClientDisconnect, DeadlineExceeded) as error:
        if checksum is not None:
            raise
        broken = error
    if checksum is not None:
        checksum.check(bytes(waiting))
    upload = await _append(uploads, upload, waiting, room)
    if broken is not None:
        raise broken
    return upload


async def _append(uploads: Uploads, upload: Upload, data: bytearray, room: Reservation) -> Upload:
    def append() -> Upload:
        room.take(len(data))
        return uploads.append(upload, bytes(data))

    return await COPIES.run(append)
