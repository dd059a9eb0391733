"""The process that reads one LAS or LAZ scan of a stranger: it confines itself, and writes an .npy.

    python -m firstfix_builder.sandbox.read_las GIVEN MADE

Both are numbers of open files. Only the standard library is imported before the process is confined.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .confine import Limits, confine

if TYPE_CHECKING:
    from firstfix.formats.las import LasCloud

MAX_MEMORY_BYTES = 2 << 30  # laspy's own and the columns' of a scan
MAX_MADE_BYTES = 256_004_096  # the most that the columns of a scan may take, and the head of the .npy


def main(given: int, made: int) -> int:
    """Read the file. Returns the exit code; the error of a file that cannot be read is in ``made``."""
    missing = confine(read=(), write=(), limits=Limits(MAX_MEMORY_BYTES, MAX_MADE_BYTES))

    from firstfix.errors import InputError, UnsupportedFormat
    from firstfix.formats.confined_las import MAX_PROCESSOR_S, REFUSED, STRICTNESS
    from firstfix.formats.las import read_las
    from firstfix.formats.laz_chunks import check_las
    from firstfix.formats.point_cloud import SCAN_LIMITS

    resource.setrlimit(resource.RLIMIT_CPU, (MAX_PROCESSOR_S, MAX_PROCESSOR_S))
    path = Path(f"/proc/self/fd/{given}")
    try:
        if missing and os.environ.get(STRICTNESS) == "required":
            raise UnsupportedFormat(f"LAS: the sandbox is required, and incomplete: {'; '.join(missing)}")
        check_las(path, SCAN_LIMITS, 8 * 5)
        _write(read_las(path, SCAN_LIMITS, with_times=True), made)
    except InputError as error:
        os.pwrite(made, json.dumps({"code": error.code, "message": str(error)}).encode(), 0)
        return REFUSED
    return 0


def _write(cloud: LasCloud, made: int) -> None:
    """Write the columns as one array of records."""
    import numpy as np

    layout = [(name, column.dtype) for name, column in cloud.columns.items()]
    records = np.empty(len(cloud), layout)
    for name, column in cloud.columns.items():
        records[name] = column
    with os.fdopen(os.dup(made), "wb") as file:
        np.save(file, records)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3])))
