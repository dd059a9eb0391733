"""The body of a request to the end of an upload, part after part: what has arrived stays, come what may."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from fastapi import Request
from starlette.requests import ClientDisconnect

from firstfix.errors import DeadlineExceeded, TooLarge
from firstfix.uploads import PART_BYTES, Upload, Uploads

from .lanes import COPIES
from .tus import Checksum


async def append_body(
    uploads: Uploads, upload: Upload, request: Request, checksum: Checksum | None, stall_s: float
) -> Upload:
    """The upload with the body at its end. One part of it is in memory at a time. When the connection
    breaks or stalls, what has arrived is kept, but for a body with a checksum: that one counts as a whole.

    Raises:
        TooLarge: more than was announced, or a body with a checksum of more than one part.
        ChecksumMismatch: the body is not what the checksum says: nothing of it is kept.
        Conflict: another writer goes on with this upload.
        DeadlineExceeded: nothing came for ``stall_s``.
    """
    waiting = bytearray()
    broken: BaseException | None = None
    try:
        async for piece in _pieces(request, stall_s):
            waiting += piece
            if upload.offset + len(waiting) > upload.size_bytes:
                raise TooLarge(f"the upload was announced with {upload.size_bytes} bytes")
            if checksum is not None and len(waiting) > PART_BYTES:
                raise TooLarge(f"a body with a checksum has at most {PART_BYTES} bytes")
            while checksum is None and len(waiting) >= PART_BYTES:
                upload = await _append(uploads, upload, waiting[:PART_BYTES])
                del waiting[:PART_BYTES]
    except (ClientDisconnect, DeadlineExceeded) as error:
        if checksum is not None:
            raise
        broken = error
    if checksum is not None:
        checksum.check(bytes(waiting))
    upload = await _append(uploads, upload, waiting)
    if broken is not None:
        raise broken
    return upload


async def _append(uploads: Uploads, upload: Upload, data: bytearray) -> Upload:
    return await COPIES.run(uploads.append, upload, bytes(data))


async def _pieces(request: Request, stall_s: float) -> AsyncIterator[bytes]:
    stream = aiter(request.stream())
    while True:
        try:
            async with asyncio.timeout(stall_s):
                piece = await anext(stream)
        except StopAsyncIteration:
            return
        except TimeoutError:
            raise DeadlineExceeded(f"nothing of the body came for {stall_s:g} s") from None
        yield piece
