"""A large file in parts, gone on with wherever the connection broke (tus 1.0)."""

from __future__ import annotations

import base64
import hashlib
from pathlib import Path

import httpx

from firstfix.errors import Conflict, FirstfixError

from .retry import Deadline
from .retrying_http import RetryingHttp

PART_BYTES = 16 << 20
_PART = {"Content-Type": "application/offset+octet-stream", "Tus-Resumable": "1.0.0"}


def upload_in_parts(http: RetryingHttp, path: Path, deadline: Deadline) -> str:
    """Sends the file and returns the upload's id. Each part is tried again by itself.

    Raises:
        FirstfixError: as the service says: no room, too large, too many uploads.
        ChecksumMismatch: the file changed on the way, or while it was read.
        DeadlineExceeded, ServiceUnreachable: as ``RetryingHttp.send``.
    """
    size = path.stat().st_size
    told = {"filename": path.name, "sha256": _sha256(path)}
    metadata = ",".join(f"{name} {_base64(value.encode())}" for name, value in told.items())

    def begin(left_s: float) -> httpx.Request:
        headers = {"Upload-Length": str(size), "Upload-Metadata": metadata, "Tus-Resumable": "1.0.0"}
        return http.request("POST", "uploads", left_s=left_s, headers=headers)

    location = http.send(begin, deadline).headers.get("Location", "")
    upload_id = location.rstrip("/").rpartition("/")[2]
    if not upload_id:
        raise FirstfixError("the service took the upload but did not say where it goes")
    offset = 0
    with path.open("rb") as file:
        while offset < size:
            file.seek(offset)
            part = file.read(PART_BYTES)
            try:
                offset = _send_part(http, upload_id, offset, part, deadline)
            except Conflict:  # the part arrived and its reply did not: where it goes on the service knows
                known = _offset(http, upload_id, deadline)
                if known <= offset:
                    raise
                offset = known
    return upload_id


def remove_upload(http: RetryingHttp, upload_id: str, deadline: Deadline) -> None:
    """What a map was made of need not stay."""
    http.send(
        lambda left_s: http.request("DELETE", "uploads", upload_id, left_s=left_s), deadline, repeatable=False
    )


def _send_part(http: RetryingHttp, upload_id: str, offset: int, part: bytes, deadline: Deadline) -> int:
    headers = {
        **_PART,
        "Upload-Offset": str(offset),
        "Upload-Checksum": f"sha256 {_base64(hashlib.sha256(part).digest())}",
    }
    answer = http.send(
        lambda left_s: http.request(
            "PATCH", "uploads", upload_id, left_s=left_s, headers=headers, content=part
        ),
        deadline,
    )
    return int(answer.headers["Upload-Offset"])


def _offset(http: RetryingHttp, upload_id: str, deadline: Deadline) -> int:
    answer = http.send(lambda left_s: http.request("HEAD", "uploads", upload_id, left_s=left_s), deadline)
    return int(answer.headers["Upload-Offset"])


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
