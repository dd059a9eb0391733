"""LAS and LAZ bodies of strangers: a confined process of the builder makes an .npy of them.

The libraries that parse them are not safe with bytes of strangers, so the process that answers queries never
loads them. A body and its array cross in memory that has a file's name.
"""

from __future__ import annotations

import json
import mmap
import os
import subprocess
import sys
from importlib.util import find_spec

from ..errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from .npy import decode_npy
from .point_cloud import Body, Limits, PointCloud

PROGRAM = "firstfix_builder.sandbox.read_las"
REFUSED = 3  # exit code: the output is an error, as JSON
MAX_PROCESSOR_S, _MAX_S = 10, 25.0  # a query may take 30 s in all
_MAX_ERROR_BYTES = 10_000
STRICTNESS = "FIRSTFIX_BUILD_SANDBOX"
_PASSED = (STRICTNESS, "PATH", "LANG", "LC_ALL", "PYTHONPATH", "LD_LIBRARY_PATH")  # no secrets of the service
_REFUSALS = {each.code: each for each in (MalformedData, TooLarge, UnsupportedFormat)}


def decode_las_confined(body: Body, limits: Limits) -> PointCloud:
    """Decode a LAS, LAZ or COPC file by a process that sees nothing of this machine.

    Raises:
        UnsupportedFormat: the builder, or laspy, is not installed here.
        MalformedData: the file is damaged, its reader crashed or took too long.
        TooLarge: over the limits.
    """
    check_installed()
    given, made = os.memfd_create("scan.las"), os.memfd_create("scan.npy")
    try:
        with os.fdopen(os.dup(given), "wb") as file:
            file.write(body)
        code = _run(given, made)
        size = os.fstat(made).st_size
        if code == REFUSED and size <= _MAX_ERROR_BYTES:
            raise _refusal(os.pread(made, size, 0))
        if code != 0 or not size:
            raise MalformedData(f"LAS: its reader crashed, or took over {MAX_PROCESSOR_S} s or its memory")
        if size > limits.max_decoded_bytes:
            raise TooLarge(f"LAS: {size} bytes when read, the limit is {limits.max_decoded_bytes}")
        return decode_npy(memoryview(mmap.mmap(made, size, access=mmap.ACCESS_READ)), limits)
    finally:
        os.close(given)
        os.close(made)


def check_installed() -> None:
    """Check that this machine has the reader.

    Raises:
        UnsupportedFormat: it has not; the error names what converts such a file.
    """
    if find_spec("firstfix_builder") is None or find_spec("laspy") is None:
        raise UnsupportedFormat(
            "LAS and LAZ are read where the builder is installed, and it is not here: "
            "`firstfix localize SCAN.laz --map MAP --url URL` converts the scan and asks"
        )


def _run(given: int, made: int) -> int:
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", PROGRAM, str(given), str(made)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=(given, made),
        env={name: os.environ[name] for name in _PASSED if name in os.environ},
    )
    try:
        return process.wait(_MAX_S)
    except subprocess.TimeoutExpired:
        raise MalformedData(f"LAS: its reader took over {_MAX_S:g} s") from None
    finally:
        process.kill()
        process.wait()


def _refusal(record: bytes) -> InputError:
    """The error that the process wrote. Nothing else of what it says is believed."""
    try:
        told = json.loads(record)
        return _REFUSALS[told["code"]](str(told["message"])[:1000])
    except (ValueError, KeyError, TypeError):
        return MalformedData("LAS: its reader failed")
