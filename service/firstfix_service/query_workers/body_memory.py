"""Memory through which bodies reach one worker process: the service writes, the worker reads.

A file without a name holds it. So the kernel frees it as soon as neither process has it open, however they
end. Each worker has memory of its own: it never sees a body of another worker's queries.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import sys
import tempfile

from firstfix.errors import TooLarge
from firstfix.formats.point_cloud import Body

KEPT_BYTES = 4 << 20  # stay in memory after a query; larger bodies are rare


class BodyMemory:
    """The service's end. For one query at a time.

    Args:
        capacity_bytes: largest body. Only the part that bodies have filled takes memory.
    """

    def __init__(self, capacity_bytes: int) -> None:
        self._capacity_bytes = capacity_bytes
        self.descriptor = _nameless_file(capacity_bytes)
        self._map = mmap.mmap(self.descriptor, capacity_bytes)

    def write(self, body: Body) -> None:
        """Copies a body to the beginning.

        Raises:
            TooLarge: it is larger than the capacity.
        """
        if len(body) > self._capacity_bytes:
            raise TooLarge(f"the body has {len(body)} bytes, the limit is {self._capacity_bytes}")
        self._map[: len(body)] = body

    def trim(self, used_bytes: int) -> None:
        """Gives back the memory of a large body, once its query has ended."""
        if used_bytes > KEPT_BYTES and sys.platform == "linux":
            self._map.madvise(mmap.MADV_REMOVE, KEPT_BYTES, self._capacity_bytes - KEPT_BYTES)

    def close(self) -> None:
        """Gives the memory back, apart from the worker's own mapping."""
        self._map.close()
        os.close(self.descriptor)


def mapped_bodies(descriptor: int, capacity_bytes: int) -> memoryview:
    """Returns the worker's view of the memory, read-only."""
    return memoryview(mmap.mmap(descriptor, capacity_bytes, access=mmap.ACCESS_READ))


def _nameless_file(size: int) -> int:
    if sys.platform == "linux":
        descriptor = os.memfd_create("firstfix-bodies", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(descriptor, size)
        # A worker cannot cut the file off: the service would die of its next write.
        fcntl.fcntl(
            descriptor, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
        )
        return descriptor
    with tempfile.TemporaryFile() as file:
        file.truncate(size)
        return os.dup(file.fileno())
