"""SHA-256 of uploads, computed while their parts pass through this process."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hashlib import _Hash

_KEPT = 64  # uploads


class RunningDigests:
    """Digests of uploads whose parts passed here in order from the start. Thread-safe.

    They save reading a file again when it is complete.
    """

    def __init__(self) -> None:
        self._digests: OrderedDict[str, tuple[int, _Hash]] = OrderedDict()  # upload: hashed bytes, digest
        self._lock = threading.Lock()

    def update(self, upload_id: str, offset: int, data: bytes) -> None:
        """Hash a part. An upload whose earlier bytes passed elsewhere is dropped."""
        with self._lock:
            hashed_bytes, digest = self._digests.pop(upload_id, (0, hashlib.sha256()))
            if hashed_bytes != offset:
                return
            digest.update(data)
            self._digests[upload_id] = (offset + len(data), digest)
            while len(self._digests) > _KEPT:
                self._digests.popitem(last=False)

    def get(self, upload_id: str, size_bytes: int) -> str | None:
        """SHA-256 of the first ``size_bytes`` of an upload as hex; None if they did not all pass here."""
        with self._lock:
            hashed_bytes, digest = self._digests.get(upload_id, (0, hashlib.sha256()))
        return digest.hexdigest() if hashed_bytes == size_bytes else None

    def drop(self, upload_id: str) -> None:
        """Forget an upload."""
        with self._lock:
            self._digests.pop(upload_id, None)
