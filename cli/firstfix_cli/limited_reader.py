"""Scan files that a library parses are read in another process, with limits on memory and processor time."""

from __future__ import annotations

import resource
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from firstfix.builds.limits import default_build_memory_bytes
from firstfix.decode import read_scan_file
from firstfix.errors import MalformedData, TooLarge
from firstfix.scan.scan import Scan

MAX_MEMORY_BYTES = 4 << 30  # a file may have 1 GB
MAX_PROCESSOR_S = 60
IN_PROCESS = (".ffscan", ".pcd", ".ply", ".bin", ".npy", ".xyz", ".txt", ".pts", ".csv")


def read_scan(path: Path) -> Scan:
    """Reads a scan as ``read_scan_file`` does. Files that a library parses are read in another process.

    Our own decoders, which also read the queries of strangers, stay in this one.

    Raises:
        NotFound: no such file.
        InputError: a subclass; the message names the file.
        MalformedData: the library crashed, or did not end.
    """
    if path.suffix.lower() in IN_PROCESS or not path.is_file():
        return read_scan_file(path)
    try:
        return _reader().submit(_read, path).result()
    except BrokenProcessPool:
        _reader.cache_clear()
        raise MalformedData(
            f"{path}: its reader crashed, or took more than {MAX_PROCESSOR_S} s of processor time"
        ) from None
    except MemoryError:
        raise TooLarge(f"{path}: its reader needs more than {_memory_bytes()} bytes of memory") from None


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


def _read(path: Path) -> Scan:
    used_s = int(time.process_time())
    resource.setrlimit(resource.RLIMIT_CPU, (used_s + MAX_PROCESSOR_S, resource.RLIM_INFINITY))
    return read_scan_file(path)
