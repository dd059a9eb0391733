"""An upload as its caller sees it: those of others are not there."""

from __future__ import annotations

from firstfix.catalog.uploads.uploads import Upload, Uploads
from firstfix.errors import NotFound

from ...auth.principal import Principal


def own_upload(uploads: Uploads, caller: Principal, upload_id: str) -> Upload:
    """
    Raises:
        NotFound: no such upload, or it is another caller's: who asks cannot tell which.
        StoreError: as the store.
    """
    upload = uploads.get(upload_id)
    if not caller.owns(upload.owner):
        raise NotFound(f"no upload {upload_id}")
    return upload
