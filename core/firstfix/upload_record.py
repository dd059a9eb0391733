"""What was announced of an upload: the content of ``uploads/<upload_id>/upload.json``."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from .errors import StoreError


@dataclass(frozen=True)
class UploadRecord:
    """
    Attributes:
        size_bytes: of the whole file.
        file_name: its ending says how to read it.
        sha256: of the whole file; None: the sender did not say.
        owner: the caller who announced it; None: a release that did not record callers wrote this.
    """

    size_bytes: int
    file_name: str
    sha256: str | None
    owner: str | None

    def to_json(self) -> bytes:
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_json(cls, upload_id: str, data: bytes) -> UploadRecord:
        """
        Raises:
            StoreError: the record cannot be read.
        """
        try:
            found = json.loads(data)
            sha256, owner = found["sha256"], found.get("owner")
            return cls(
                int(found["size_bytes"]),
                str(found["file_name"]),
                None if sha256 is None else str(sha256),
                None if owner is None else str(owner),
            )
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise StoreError(f"the record of upload {upload_id} cannot be read: {error!r}") from None
