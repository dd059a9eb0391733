"""Scan files that a library parses are read in another process, with limits on memory and processor time."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

from firstfix.builds.limits import default_build_memory_bytes
from firstfix.errors import InputError, UnsupportedFormat
from firstfix.formats.laz_chunks import check_las
from firstfix.formats.point_cloud import SCAN_LIMITS, PointCloud
from firstfix.recording.confined_process import ConfinedProcess, Limits
from firstfix.recording.recording import is_recording
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_cloud_file, read_scan_file

from .bags.first_cloud import first_cloud

MAX_MEMORY_BYTES = 4 << 30  # a file may have 1 GB
MAX_PROCESSOR_S = 60
BY_LIBRARY = (".las", ".laz")
_Result = TypeVar("_Result")


def read_scan(path: Path, columns: tuple[str, ...] | None = None) -> Scan:
    """Read a scan as ``read_scan_file`` does. Files that a library parses are read in another process.

    Our own decoders, which also read the queries of strangers, stay in this one.

    Args:
        columns: of a .bin, as there.

    Raises:
        NotFound: no such file.
        InputError: a subclass; the message names the file.
        UnsupportedFormat: a recording: ``localize --bag`` takes it.
        MalformedData, TooLarge: the library crashed, did not end, or needs more memory than it may.
    """
    if is_recording(path):
        raise UnsupportedFormat(f"{path}: no scan: `firstfix localize --bag {path.name}` takes recordings")
    return _limited(path, partial(read_scan_file, columns=columns))


def read_cloud(path: Path, columns: tuple[str, ...] | None = None) -> PointCloud:
    """Read the columns of a scan's file, as ``read_cloud_file`` does; of a recording its first cloud.

    Raises:
        NotFound, InputError: as ``read_scan``.
    """
    if is_recording(path):
        with limited_memory():
            return first_cloud(path)
    return _limited(path, partial(read_cloud_file, columns=columns))


def _limited(path: Path, read: Callable[[Path], _Result]) -> _Result:
    if path.suffix.lower() not in BY_LIBRARY or not path.is_file():
        return read(path)
    try:
        return _reader().run(_read, path, read)
    except InputError as error:
        raise type(error)(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


@contextmanager
def limited_memory() -> Iterator[None]:
    """Limit the memory of this process to that of a build: for bags, whose messages come one by one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    within = [
        limit for limit in (default_build_memory_bytes(), soft, hard) if limit != resource.RLIM_INFINITY
    ]
    resource.setrlimit(resource.RLIMIT_DATA, (min(within), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@cache
def _reader() -> ConfinedProcess:
    """The process, which starts with the first file and then reads all of them."""
    return ConfinedProcess(Limits(min(MAX_MEMORY_BYTES, default_build_memory_bytes()), MAX_PROCESSOR_S))


def _read(path: Path, read: Callable[[Path], _Result]) -> _Result:
    check_las(path, SCAN_LIMITS, 8 * 5)
    return read(path)
