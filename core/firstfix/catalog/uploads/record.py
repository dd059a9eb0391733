"""Records of an upload: what was announced, and the sha256 of the complete file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ...ids import check_version
from ...store.json_record import record_json, text_of, whole_number_of


@dataclass(frozen=True)
class UploadRecord:
    """Announcement of an upload, the content of ``upload.json``.

    Attributes:
        size_bytes: of the whole file.
        file_name: its ending tells the format.
        sha256: of the whole file; None if the sender did not give it.
        owner: caller who announced the upload; None if the record is from a release without callers.
    """

    size_bytes: int
    file_name: str
    sha256: str | None
    owner: str | None

    def to_json(self) -> bytes:
        """Content of ``upload.json``."""
        return record_json(asdict(self))

    @classmethod
    def parse(cls, record: dict[str, Any]) -> UploadRecord:
        """Parse the content of ``upload.json``.

        Raises:
            KeyError, TypeError, ValueError, InvalidOption: it is not the record of an upload.
        """
        sha256, owner = record["sha256"], record["owner"]
        return cls(
            whole_number_of(record, "size_bytes"),
            text_of(record, "file_name"),
            None if sha256 is None else check_version(sha256),
            None if owner is None else text_of(record, "owner"),
        )


def parse_whole(record: dict[str, Any]) -> str:
    """SHA-256 of a complete upload, from the content of ``whole.json``.

    Raises:
        KeyError, TypeError, InvalidOption: the record has no valid sha256.
    """
    return check_version(record["sha256"])
