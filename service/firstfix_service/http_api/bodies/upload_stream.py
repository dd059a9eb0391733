"""The body of a request to the end of an upload, part after part: what has arrived stays, come what may."""

from __future__ import annotations

from fastapi import Request
from starlette.requests import ClientDisconnect

from firstfix.catalog.uploads.parts import PART_BYTES
from firstfix.catalog.uploads.uploads import Upload, Uploads
from firstfix.errors import DeadlineExceeded, TooLarge

from ...lanes import COPIES
from .disk_space import Reservation
from .paced_body import Pace, paced_pieces
from .tus import Checksum


async def append_body(
    uploads: Uploads,
    upload: Upload,
    request: Request,
    checksum: Checksum | None,
    pace: Pace,
    room: Reservation,
) -> Upload:
    """The upload with the body at its end. One part of it is in memory at a time. When the connection
    breaks or is too slow, what has arrived is kept, but for a body with a checksum: that one counts as a
    whole.

    Raises:
        TooLarge: more than was announced, or a body with a checksum of more than one part.
        ChecksumMismatch: the body is not what the checksum says: nothing of it is kept.
        Conflict: another writer goes on with this upload.
        DeadlineExceeded: the body does not keep the pace.
        OutOfSpace: the store's disk has run full.
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
