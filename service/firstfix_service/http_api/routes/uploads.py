"""/uploads: resumable uploads of large map files (tus 1.0).

The parts are in the store, so any replica can continue an upload that another one began.
"""

from __future__ import annotations

import uuid
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request, Response

from firstfix.access.permissions import Scope
from firstfix.catalog.uploads.uploads import Upload
from firstfix.errors import Conflict, InvalidOption, TooLarge, UnsupportedFormat
from firstfix.ids import check_version

from ...thread_pools import CHANGES, COPIES, LISTS, READS
from ..bodies import tus
from ..bodies.form import harmless_name
from ..bodies.uploads import append_body, own_upload
from ..edge import CallerDep, needs
from ..parts import UploadPartsDep
from ..schema.api_models import UploadStatus
from ..schema.bodies import binary_body
from ..schema.parameters import UploadId

router = APIRouter(prefix="/uploads", tags=["uploads"])
TusResumable = Annotated[str | None, Header(description="the caller's tus version, 1.0.0")]
_DIGITS = {"pattern": "^[0-9]{1,18}$"}


def _headers(*names: str) -> dict[str, Any]:
    return {"headers": {name: {"schema": {"type": "string"}} for name in names}}


_STATE_HEADERS = _headers("Upload-Offset", "Upload-Length", "Upload-Expires", "Tus-Resumable")


@router.options(
    "", status_code=204, responses={204: _headers("Tus-Version", "Tus-Extension", "Tus-Max-Size")}
)
@needs(Scope.BUILD)
async def describe_uploads(parts: UploadPartsDep) -> Response:
    """The tus version, extensions and limits of this service."""
    return Response(
        status_code=204,
        headers={
            "Tus-Resumable": tus.VERSION,
            "Tus-Version": tus.VERSION,
            "Tus-Extension": tus.EXTENSIONS,
            "Tus-Checksum-Algorithm": ",".join(tus.CHECKSUMS),
            "Tus-Max-Size": str(parts.max_bytes),
        },
    )


@router.post(
    "",
    status_code=201,
    responses={201: {**_headers("Location", "Upload-Offset", "Upload-Expires"), "description": "created"}},
)
@needs(Scope.BUILD)
@LISTS.route
def begin_upload(
    parts: UploadPartsDep,
    caller: CallerDep,
    response: Response,
    upload_length: Annotated[
        str, Header(description="bytes of the whole file", json_schema_extra=_DIGITS, examples=["5000000000"])
    ],
    upload_metadata: Annotated[
        str,
        Header(
            description="pairs of a name and a base64 value: `filename`, whose suffix says how the file is "
            "read, and optionally `sha256` of the whole file, 64 hex characters",
            examples=["filename aGFsbC5sYXo="],
        ),
    ],
    tus_resumable: TusResumable = None,
) -> UploadStatus:
    """Create an upload. Send its bytes by PATCH to the Location.

    An upload without new bytes for a day is removed. Only its caller, and callers with the scope `admin`, see
    it. 429 `quota_exceeded`: the caller has too many open uploads or bytes.
    """
    tus.check_version(tus_resumable)
    size_bytes = tus.number("Upload-Length", upload_length)
    if size_bytes < 1:
        raise InvalidOption("Upload-Length is 0: a map file must not be empty")
    if size_bytes > parts.max_bytes:
        raise TooLarge(f"a file has at most {parts.max_bytes} bytes")
    metadata = tus.metadata(upload_metadata)
    if not metadata.get("filename"):
        raise InvalidOption("Upload-Metadata has no filename")
    sha256 = metadata.get("sha256")
    if sha256 is not None:
        check_version(sha256)
    upload_id, name = f"u{uuid.uuid4().hex}", harmless_name(metadata["filename"])
    with parts.disks.reserve("the store's disk", parts.store.directory) as room:
        room.ensure(size_bytes)  # refused at once without room; reserved as bytes arrive
    parts.quota.begin(caller.name, upload_id, size_bytes=size_bytes, file_name=name, sha256=sha256)
    upload = parts.uploads.get(upload_id)
    response.headers.update({**tus.headers_of(upload), "Location": f"/uploads/{upload_id}"})
    return _status(upload)


@router.head("/{upload_id}", response_class=Response, responses={200: _STATE_HEADERS})
@needs(Scope.BUILD)
@READS.route
def get_upload_offset(
    upload_id: UploadId, parts: UploadPartsDep, caller: CallerDep, tus_resumable: TusResumable = None
) -> Response:
    """Offset at which to continue, in `Upload-Offset`."""
    tus.check_version(tus_resumable)
    return Response(headers=tus.headers_of(own_upload(parts.uploads, caller, upload_id)))


@router.get("/{upload_id}")
@needs(Scope.BUILD)
@READS.route
def get_upload(upload_id: UploadId, parts: UploadPartsDep, caller: CallerDep) -> UploadStatus:
    """State of an upload, for people."""
    return _status(own_upload(parts.uploads, caller, upload_id))


@router.patch(
    "/{upload_id}",
    status_code=204,
    responses={204: _STATE_HEADERS},
    openapi_extra=binary_body([tus.MEDIA_TYPE]),
)
@needs(Scope.BUILD)
async def append_to_upload(
    upload_id: UploadId,
    request: Request,
    parts: UploadPartsDep,
    caller: CallerDep,
    upload_offset: Annotated[
        str,
        Header(description="offset of the body's first byte, as HEAD returns it", json_schema_extra=_DIGITS),
    ],
    upload_checksum: Annotated[
        str | None,
        Header(
            description="`sha256` or `sha1`, and the body's digest in base64. The body then has up to 16 MiB"
        ),
    ] = None,
    tus_resumable: TusResumable = None,
) -> Response:
    """Append the body to an upload.

    409: the upload continues at another offset, ask HEAD. 460: a checksum does not match. The body is then
    discarded; if the whole file does not match, the upload is removed.
    """
    tus.check_version(tus_resumable)
    media_type = request.headers.get("content-type", "").split(";", 1)[0].strip().lower()
    if media_type != tus.MEDIA_TYPE:
        raise UnsupportedFormat(f"the media type of a part is {tus.MEDIA_TYPE}")
    offset = tus.number("Upload-Offset", upload_offset)
    checksum = None if upload_checksum is None else tus.Checksum(upload_checksum)
    with parts.streams.request(caller.name):
        upload = await READS.run(own_upload, parts.uploads, caller, upload_id)
        if offset != upload.offset:
            raise Conflict(f"upload {upload_id} continues at {upload.offset}, not at {offset}")
        with parts.disks.reserve("the store's disk", parts.store.directory) as room:
            await READS.run(room.ensure, upload.size_bytes - offset)
            upload = await append_body(parts.uploads, upload, request, checksum, parts.pace, room)
        if upload.complete:
            await COPIES.run(parts.uploads.finish, upload)
    return Response(status_code=204, headers=tus.headers_of(upload))


@router.delete("/{upload_id}", status_code=204)
@needs(Scope.BUILD)
@CHANGES.route
def delete_upload(
    upload_id: UploadId, parts: UploadPartsDep, caller: CallerDep, tus_resumable: TusResumable = None
) -> Response:
    """Remove an upload, complete or not. A map that was built from it keeps its own copy."""
    tus.check_version(tus_resumable)
    own_upload(parts.uploads, caller, upload_id)
    parts.uploads.remove(upload_id)
    return Response(status_code=204, headers={"Tus-Resumable": tus.VERSION})


def _status(upload: Upload) -> UploadStatus:
    return UploadStatus(
        upload_id=upload.upload_id,
        file_name=upload.file_name,
        size_bytes=upload.size_bytes,
        offset_bytes=upload.offset,
        sha256=upload.sha256,
        complete=upload.complete,
    )
