"""Quotas of open uploads, of one caller and of all."""

from __future__ import annotations

import threading

from firstfix.catalog.uploads.record import UploadRecord
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.errors import Overloaded, QuotaExceeded

# Each begin lists all open uploads, so there are not many. No caller has more than an eighth of them.
MAX_OPEN, MAX_OPEN_PER_CALLER = 256, 32
LARGEST_FILES_PER_CALLER = 5


class UploadQuota:
    """Limits of open uploads. Thread-safe.

    Several replicas that begin uploads of one caller at the same moment may each let one pass.

    Args:
        max_upload_bytes: size of one upload. The open ones of a caller may have ``LARGEST_FILES_PER_CALLER``
            times that, as announced.
    """

    def __init__(self, uploads: Uploads, max_upload_bytes: int) -> None:
        self._uploads = uploads
        self._max_open, self._max_open_per_caller = MAX_OPEN, MAX_OPEN_PER_CALLER
        self._max_bytes_per_caller = LARGEST_FILES_PER_CALLER * max_upload_bytes
        self._beginning: dict[str, UploadRecord] = {}
        self._lock = threading.Lock()

    def begin(
        self, owner: str, upload_id: str, *, size_bytes: int, file_name: str, sha256: str | None
    ) -> None:
        """Creates an upload within the quotas.

        Raises:
            QuotaExceeded: the caller has reached its quota.
            Overloaded: all callers together have too many.
        """
        wanted = UploadRecord(size_bytes, file_name, sha256, owner)
        with self._lock:  # not held during requests to the store
            self._beginning[upload_id] = wanted
            beginning = dict(self._beginning)
        try:
            self._check(owner, {**self._uploads.announced(), **beginning})
            self._uploads.create(
                upload_id, size_bytes=size_bytes, file_name=file_name, sha256=sha256, owner=owner
            )
        finally:
            with self._lock:
                del self._beginning[upload_id]

    def _check(self, owner: str, records: dict[str, UploadRecord]) -> None:
        sizes = [record.size_bytes for record in records.values() if record.owner == owner]
        if len(sizes) > self._max_open_per_caller:
            raise QuotaExceeded(
                f"{self._max_open_per_caller} uploads of this caller are open: remove some with DELETE"
            )
        if sum(sizes) > self._max_bytes_per_caller:
            raise QuotaExceeded(
                f"the open uploads of one caller have at most {self._max_bytes_per_caller} bytes together: "
                "remove some with DELETE"
            )
        if len(records) > self._max_open:
            raise Overloaded(f"{self._max_open} uploads are open: try again")
