"""Arrays in new files, with their room on the disk taken at once.

A mapped file is sparse: without that, a write on a full disk ends the process with SIGBUS and without a word.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from firstfix.errors import OutOfSpace

_FULL = (errno.ENOSPC, errno.EDQUOT)
_UNSUPPORTED = (errno.EOPNOTSUPP, errno.EINVAL)  # of file systems that take room only when it is written


def mapped_array(path: Path, dtype: DTypeLike, shape: tuple[int, ...]) -> np.memmap[Any, np.dtype[Any]]:
    """The array of a new .npy file.

    Raises:
        OutOfSpace: the disk has no room for it.
    """
    array = np.lib.format.open_memmap(path, "w+", np.dtype(dtype), shape)
    with path.open("r+b") as file:
        _take_room(file)
    return array


def mapped_scratch(file: IO[bytes], dtype: DTypeLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array in an open, empty file, which may be without a name.

    Raises:
        OutOfSpace: the disk has no room for it.
    """
    array = np.memmap(file, dtype, "w+", shape=shape)
    _take_room(file)
    return array


def _take_room(file: IO[bytes]) -> None:
    needed = os.fstat(file.fileno()).st_size
    if not needed:
        return
    try:
        os.posix_fallocate(file.fileno(), 0, needed)
    except OSError as error:
        if error.errno in _FULL:
            disk = os.fstatvfs(file.fileno())
            free = disk.f_bavail * disk.f_frsize
            raise OutOfSpace(
                f"the work disk is full: {needed} bytes are needed for a file, and {free} bytes are left"
            ) from None
        if error.errno not in _UNSUPPORTED:
            raise
