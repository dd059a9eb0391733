"""Room on the disks for what arrives: promised before it is taken, so that no two get the same bytes."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firstfix.errors import OutOfSpace


class DiskSpace:
    """Ledger of the process: promised bytes of each disk. Thread-safe.

    Args:
        min_free_bytes: that stay free on every disk.
    """

    def __init__(self, min_free_bytes: int) -> None:
        self._min_free_bytes = min_free_bytes
        self._open: list[Reservation] = []
        self._lock = threading.Lock()

    @contextmanager
    def reserve(self, what: str, directory: Path | None) -> Iterator[Reservation]:
        """A reservation on the directory's disk, of nothing yet. What it is promised is given back when the
        block ends, however it ends. The disk is not asked: that is for a thread to do.

        Args:
            what: for people: whose disk it is.
            directory: None: a store that is no directory, and has any room.
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
        """Promised and not yet written, on all disks."""
        with self._lock:
            return sum(one.outstanding_bytes for one in self._open)

    def ensure(self, reservation: Reservation, size_bytes: int, next_bytes: int) -> None:
        """See ``Reservation``: makes it up to ``size_bytes``, of which ``next_bytes`` are written next."""
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
            # A promise counts beside those of others; what is written needs room whatever was promised.
            if (more and promised + more > room) or (next_bytes and next_bytes > room):
                raise OutOfSpace(f"{reservation.what} has no room for {max(more, next_bytes)} more bytes")
            reservation.promised_bytes += more
            reservation.taken_bytes += next_bytes


class Reservation:
    """One caller's share of a disk. What it was promised stays promised until it is written.

    Attributes:
        promised_bytes: in all, written ones too.
        taken_bytes: that were or are just being written.
        written_bytes: that the disk itself counts as used.
    """

    def __init__(self, ledger: DiskSpace, what: str, directory: Path | None) -> None:
        self.what = what
        self.directory = directory
        self.device: int | None = None
        self.promised_bytes = self.taken_bytes = self.written_bytes = 0
        self._ledger = ledger

    @property
    def outstanding_bytes(self) -> int:
        return self.promised_bytes - self.written_bytes

    def ensure(self, size_bytes: int) -> None:
        """Makes it a promise of so many bytes in all, if it is not one already.

        Raises:
            OutOfSpace: there is not so much beside what others were promised.
        """
        self._ledger.ensure(self, size_bytes, 0)

    def take(self, size_bytes: int) -> None:
        """To be called before so many bytes are written, after those of the last call were.

        Raises:
            OutOfSpace: they were not promised and there is no room, or the disk has run full otherwise.
        """
        self._ledger.ensure(self, self.taken_bytes + size_bytes, size_bytes)
