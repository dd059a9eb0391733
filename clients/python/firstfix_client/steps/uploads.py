"""Resumable upload of a large file in parts (tus 1.0)."""

from __future__ import annotations

import base64
import hashlib
from functools import partial
from pathlib import Path

from firstfix.errors import Conflict, FirstfixError

from .deadline import Deadline
from .http_messages import HttpRequest
from .http_sender import HttpSender
from .step import Steps, work

PART_BYTES = 16 << 20
_PART = {"Content-Type": "application/offset+octet-stream", "Tus-Resumable": "1.0.0"}


def upload_in_parts(http: HttpSender, path: Path, deadline: Deadline) -> Steps[str]:
    """Sends the file and returns the upload's id. Each part has its own retries.

    Raises:
        FirstfixError: from the service: no room, too large, too many uploads.
        ChecksumMismatch: the file changed in transfer, or while it was read.
        DeadlineExceeded, ServiceUnreachable: see ``send.send``.
    """
    size = path.stat().st_size
    described = {"filename": path.name, "sha256": (yield from work(partial(_sha256, path)))}
    metadata = ",".join(f"{name} {_base64(value.encode())}" for name, value in described.items())
    headers = {"Upload-Length": str(size), "Upload-Metadata": metadata, "Tus-Resumable": "1.0.0"}
    begin = HttpRequest("POST", ("uploads",), headers=headers)
    upload_id = (yield from http.send_same(begin, deadline)).last_of_location
    if not upload_id:
        raise FirstfixError("the service accepted the upload but returned no upload id")
    offset = 0
    while offset < size:
        request = yield from work(partial(_part, path, upload_id, offset))
        try:
            answer = yield from http.send_same(request, deadline)
        except Conflict:  # the part arrived but its reply was lost: ask the service for the offset
            look = HttpRequest("HEAD", ("uploads", upload_id))
            answer = yield from http.send_same(look, deadline)
            if int(answer.headers["Upload-Offset"]) <= offset:
                raise
        offset = int(answer.headers["Upload-Offset"])
    return upload_id


def remove_upload(http: HttpSender, upload_id: str, deadline: Deadline) -> Steps[None]:
    """Removes an upload that is no longer needed."""
    request = HttpRequest("DELETE", ("uploads", upload_id))
    yield from http.send_same(request, deadline, repeatable=False)


def _part(path: Path, upload_id: str, offset: int) -> HttpRequest:
    with path.open("rb") as file:
        file.seek(offset)
        content = file.read(PART_BYTES)
    headers = {
        **_PART,
        "Upload-Offset": str(offset),
        "Upload-Checksum": f"sha256 {_base64(hashlib.sha256(content).digest())}",
    }
    return HttpRequest("PATCH", ("uploads", upload_id), headers=headers, content=content)


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
