"""A recording as one file a scan, with the time in its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InputError, MalformedData, NotFound, TooLarge
from firstfix.scan.scan import Scan
from firstfix.scan_file import MAX_SCAN_FILE_BYTES
from firstfix.transform import Matrix

from .ground_truth import GroundTruth
from .recording import RecordedScan, Recording


class ScanFiles(Recording):
    """Reads scans from files when they are asked for."""

    def __init__(
        self,
        files: dict[int, Path],
        truth: GroundTruth,
        T_body_sensor: Matrix,
        read_scan: Callable[[Path], Scan],
    ) -> None:
        super().__init__(list(files), truth, T_body_sensor)
        self._files = files
        self._read_scan = read_scan

    def read(self, chosen: NDArray[np.intp]) -> Iterator[RecordedScan]:
        """Read these scans one after the other, see ``Recording``."""
        for k in chosen:
            path = self._files[int(self.stamps_ns[k])]
            try:
                scan = self._read_scan(path)
            except InputError as error:
                message = str(error)
                raise type(error)(message if str(path) in message else f"{path}: {message}") from error
            yield RecordedScan(str(path), scan, self.T_map_sensor[k])


def files_by_stamp(folder: Path, pattern: str, stamp_ns: Callable[[str], int]) -> dict[int, Path]:
    """Find the scans of a folder by the time in nanoseconds that the stem of each name gives.

    Raises:
        NotFound: no such folder, or no file with such a name.
        MalformedData: a name that gives no time.
    """
    if not folder.is_dir():
        raise NotFound(f"{folder}: no such folder")
    files: dict[int, Path] = {}
    for path in folder.glob(pattern):
        try:
            files[stamp_ns(path.stem)] = path
        except ValueError:
            raise MalformedData(f"{path}: the name gives no time") from None
    if not files:
        raise NotFound(f"{folder}: no file {pattern}")
    return files


def content_of(path: Path) -> bytes:
    """Read the file of a scan.

    Raises:
        TooLarge: over 1 GB.
    """
    size = path.stat().st_size
    if size > MAX_SCAN_FILE_BYTES:
        raise TooLarge(f"{size} bytes, the limit is {MAX_SCAN_FILE_BYTES}")
    return path.read_bytes()


def first_file(*candidates: Path) -> Path:
    """The first of these files that is there.

    Raises:
        NotFound: none is.
    """
    found = next((path for path in candidates if path.is_file()), None)
    if found is None:
        raise NotFound(f"no such file: {' or '.join(map(str, candidates))}")
    return found
