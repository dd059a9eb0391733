"""Scan files that a library parses are read in another process, with limits on memory and processor time."""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from firstfix.builds.limits import default_build_memory_bytes
from firstfix.errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.laz_chunks import check_las
from firstfix.formats.point_cloud import SCAN_LIMITS, PointCloud
from firstfix.recording.recording import is_recording
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_cloud_file, read_scan_file

from .bags.first_cloud import first_cloud

MAX_MEMORY_BYTES = 4 << 30  # a file may have 1 GB
MAX_PROCESSOR_S = 60
BY_LIBRARY = (".las", ".laz")
_Read = TypeVar("_Read")


def read_scan(path: Path, columns: tuple[str, ...] | None = None) -> Scan:
    """Read a scan as ``read_scan_file`` does. Files that a library parses are read in another process.

    Our own decoders, which also read the queries of strangers, stay in this one.

    Args:
        columns: of a .bin, as there.

    Raises:
        NotFound: no such file.
        InputError: a subclass; the message names the file.
        UnsupportedFormat: a recording: ``localize --bag`` takes it.
        MalformedData: the library crashed, or did not end.
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


def _limited(path: Path, read: Callable[[Path], _Read]) -> _Read:
    if path.suffix.lower() not in BY_LIBRARY or not path.is_file():
        return read(path)
    try:
        return _reader().submit(_read, path, read).result()
    except BrokenProcessPool:
        _reader.cache_clear()
        raise MalformedData(
            f"{path}: its reader crashed, or took more than {MAX_PROCESSOR_S} s of processor time"
        ) from None
    except MemoryError:
        raise TooLarge(f"{path}: its reader needs more than {_memory_bytes()} bytes of memory") from None


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
def _reader() -> ProcessPoolExecutor:
    """The process, which starts with the first file and then reads all of them."""
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_limit)


def _memory_bytes() -> int:
    return min(MAX_MEMORY_BYTES, default_build_memory_bytes())


def _limit() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (_memory_bytes(), _memory_bytes()))


def _read(path: Path, read: Callable[[Path], _Read]) -> _Read:
    used_s = int(time.process_time())
    resource.setrlimit(resource.RLIMIT_CPU, (used_s + MAX_PROCESSOR_S, resource.RLIM_INFINITY))
    try:
        check_las(path, SCAN_LIMITS, 8 * 5)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from None
    return read(path)
