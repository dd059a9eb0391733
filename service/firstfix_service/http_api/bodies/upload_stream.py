"""Bodies of tus uploads: what has arrived is stored, even if the connection breaks."""

from __future__ import annotations

from fastapi import Request
from starlette.requests import ClientDisconnect

from firstfix.catalog.uploads.parts import PART_BYTES
from firstfix.catalog.uploads.uploads import Upload, Uploads
from firstfix.errors import DeadlineExceeded, NotFound, TooLarge

from ...auth.principal import Principal
from ...thread_pools import COPIES
from .disk_space import Reservation
from .paced_body import Pace, paced_pieces
from .tus import Checksum


def own_upload(uploads: Uploads, caller: Principal, upload_id: str) -> Upload:
    """Returns an upload of this caller.

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
    """Appends a request's body to an upload, and returns the upload.

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
