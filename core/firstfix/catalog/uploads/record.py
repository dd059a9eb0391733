"""Record of an announced upload: the content of ``uploads/<upload_id>/upload.json``."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from ...ids import check_version
from ...store.json_record import text_of, whole_number_of


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
    def parse(cls, record: dict[str, Any]) -> UploadRecord:
        """
        Raises:
            KeyError, TypeError, ValueError, InvalidOption: not what an upload announces.
        """
        sha256, owner = record["sha256"], record.get("owner")
        return cls(
            whole_number_of(record, "size_bytes"),
            text_of(record, "file_name"),
            None if sha256 is None else check_version(sha256),
            None if owner is None else text_of(record, "owner"),
        )
