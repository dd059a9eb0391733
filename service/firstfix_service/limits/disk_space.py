"""Disk space for files that arrive. It is reserved before use, so no two requests count on the same bytes."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firstfix.errors import OutOfSpace


class DiskSpace:
    """Reserved bytes of each disk, of this process. Thread-safe.

    Args:
        min_free_bytes: stay free on every disk.
    """

    def __init__(self, min_free_bytes: int) -> None:
        self._min_free_bytes = min_free_bytes
        self._open: list[Reservation] = []
        self._lock = threading.Lock()

    @contextmanager
    def reserve(self, what: str, directory: Path | None) -> Iterator[Reservation]:
        """Open a reservation of zero bytes on the directory's disk. It is given back when the block ends.

        This does not block: the disk is only read by ``Reservation.ensure`` and ``take``.

        Args:
            what: name of the disk, for error messages.
            directory: None: a store without a directory, which is never full.
        """
        reservation = Reservation(self, what, directory)
        with self._lock:
            self._open.append(reservation)
        try:
            yield reservation
        finally:
            with self._lock:
                self._open.remove(reservation)

    @property
    def promised_bytes(self) -> int:
        """Reserved bytes that are not written yet, on all disks."""
        with self._lock:
            return sum(one.outstanding_bytes for one in self._open)

    def ensure(self, reservation: Reservation, size_bytes: int, next_bytes: int) -> None:
        """Grows a reservation to ``size_bytes``, of which ``next_bytes`` are written next."""
        if reservation.directory is None:
            return
        if reservation.device is None:
            reservation.device = reservation.directory.stat().st_dev
        free = shutil.disk_usage(reservation.directory).free
        with self._lock:
            reservation.written_bytes = reservation.taken_bytes
            more = max(size_bytes - reservation.promised_bytes, 0)
            promised = sum(one.outstanding_bytes for one in self._open if one.device == reservation.device)
            room = free - self._min_free_bytes
            # A reservation counts beside those of others; a write needs room even if it was reserved.
            if (more and promised + more > room) or (next_bytes and next_bytes > room):
                raise OutOfSpace(f"{reservation.what} has no room for {max(more, next_bytes)} more bytes")
            reservation.promised_bytes += more
            reservation.taken_bytes += next_bytes


class Reservation:
    """One request's share of a disk. Its bytes stay reserved until they are written.

    Attributes:
        promised_bytes: reserved in all, written ones included.
        taken_bytes: written, or being written now.
        written_bytes: counted as used by the disk itself.
    """

    def __init__(self, ledger: DiskSpace, what: str, directory: Path | None) -> None:
        self.what = what
        self.directory = directory
        self.device: int | None = None
        self.promised_bytes = self.taken_bytes = self.written_bytes = 0
        self._ledger = ledger

    @property
    def outstanding_bytes(self) -> int:
        """Reserved bytes that are not written yet."""
        return self.promised_bytes - self.written_bytes

    def ensure(self, size_bytes: int) -> None:
        """Reserve so many bytes in all, if fewer are reserved.

        Raises:
            OutOfSpace: there is not enough room beside the other reservations.
        """
        self._ledger.ensure(self, size_bytes, 0)

    def take(self, size_bytes: int) -> None:
        """Announce a write of so many bytes. Call it after the previous write has ended.

        Raises:
            OutOfSpace: the bytes are not reserved and there is no room, or the disk is full.
        """
        self._ledger.ensure(self, self.taken_bytes + size_bytes, size_bytes)
