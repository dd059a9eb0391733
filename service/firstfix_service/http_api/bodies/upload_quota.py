"""Quotas of open uploads, of one caller and of all."""

from __future__ import annotations

import threading

from firstfix.catalog.uploads.record import UploadRecord
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.errors import Overloaded, QuotaExceeded


class UploadQuota:
    """Limits of open uploads. Thread-safe.

    Several replicas that begin uploads of one caller at the same moment may each let one pass.

    Args:
        max_open: uploads of all callers.
        max_open_per_caller: uploads of one caller.
        max_bytes_per_caller: announced bytes of one caller's open uploads.
    """

    def __init__(
        self, uploads: Uploads, *, max_open: int, max_open_per_caller: int, max_bytes_per_caller: int
    ) -> None:
        self._uploads = uploads
        self._max_open = max_open
        self._max_open_per_caller = max_open_per_caller
        self._max_bytes_per_caller = max_bytes_per_caller
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
