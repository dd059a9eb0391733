"""The formats of scans: one table of media types, signatures and decoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType

import numpy as np

from .errors import UnsupportedFormat
from .formats.pcd import decode_pcd
from .formats.ply import decode_ply
from .formats.point_cloud import SCAN_LIMITS, Body, Limits, PointCloud
from .formats.point_times import point_times
from .formats.raw_xyz import decode_rows, decode_xyz, decode_xyzi
from .formats.signature import Begins, begins_as_pcd, begins_as_text, begins_with
from .ros.media_types import CDR, ZENOH_CDR
from .ros.point_cloud2 import decode_point_cloud2
from .scan.scan import Scan
from .scan.sequence import AnyScan, ScanSequence

ROWS = "application/vnd.firstfix.xyzi"
# Types that say nothing of the body: none, those of programs that do not know it, curl's own, and zenoh's.
GENERAL_TYPES = frozenset(
    {
        "",
        "application/octet-stream",
        "binary/octet-stream",
        "application/x-www-form-urlencoded",
        "zenoh/bytes",
    }
)


def dataset_files_of(what: str) -> ModuleType:
    """The module of formats that the robot's distribution leaves out.

    Args:
        what: is to be read, for the error.

    Raises:
        UnsupportedFormat: it is left out.
    """
    try:
        from .formats import dataset_files
    except ImportError as error:
        raise UnsupportedFormat(
            "the robot's client reads .ffscan, .pcd and .ply files, and arrays: install firstfix itself for "
            f"{what}"
        ) from error
    return dataset_files


def decode_wire(body: Body) -> Scan:
    """The scan in a body of the service's own format."""
    from .wire import scan as wire  # imported late: the other decoders do not need zstandard

    return wire.decode_scan(body)


def _decode_sequence(body: Body) -> ScanSequence:
    from .wire import sequence as wire_sequence

    return wire_sequence.decode_scans(body)


def _decode_compact(body: Body) -> AnyScan:
    from .wire import query as wire_query

    return wire_query.decode_query(body)


def decode_cdr(body: Body) -> Scan:
    """The scan in a ROS PointCloud2."""
    return decode_point_cloud2(body, SCAN_LIMITS).scan()


def _decode_npy(body: Body) -> Scan:
    return scan_of_cloud(dataset_files_of(".npy").decode_npy(body, SCAN_LIMITS))


def _decode_text(body: Body) -> Scan:
    return scan_of_cloud(dataset_files_of("text").decode_text(body, SCAN_LIMITS))


def _decode_cloud(decode: Callable[[Body, Limits], PointCloud], body: Body) -> Scan:
    return scan_of_cloud(decode(body, SCAN_LIMITS))


def decode_named_rows(columns: tuple[str, ...], body: Body) -> Scan:
    """The scan in rows of float32 with these columns."""
    return scan_of_cloud(decode_rows(body, columns, SCAN_LIMITS))


def _by(decode: Callable[[Body, Limits], PointCloud]) -> Callable[[Body], Scan]:
    return partial(_decode_cloud, decode)


def scan_of_cloud(cloud: PointCloud) -> Scan:
    """Make a scan of a file's columns, with the times of its points.

    Raises:
        InvalidScan, TooLarge: as ``Scan.from_columns``.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # an intensity may be any float32
        x, y, z = (cloud.columns[axis] for axis in "xyz")
        times = point_times(cloud.columns, None)
        return Scan.from_columns(x, y, z, cloud.intensity, times.stamp_s, times.time_s, times.field)


@dataclass(frozen=True)
class ScanFormat:
    """A format of scans.

    Attributes:
        media_types: the first is the one to send; the others mean the same.
        encoding: the format in the words of clients/PROTOCOL.md.
        decode: makes a scan of a body. It can be pickled.
        suffix: ending of files that clients send without change.
        begins: tells the format by the first bytes of a body; None: they say nothing.
    """

    media_types: tuple[str, ...]
    encoding: str
    decode: Callable[[Body], AnyScan]
    suffix: str | None = None
    begins: Begins | None = None


# What is told elsewhere is made from these rows: `python scripts/generate.py`.
SCAN_FORMATS = (
    ScanFormat(
        ("application/vnd.firstfix.scan",),
        "compressed, as points or as a [range image](protocol/range-image.md): [scan.md](protocol/scan.md)",
        decode_wire,
        ".ffscan",
        begins_with(b"FFSC"),
    ),
    ScanFormat(("application/vnd.firstfix.xyz",), "raw little-endian float32, n x 3", _by(decode_xyz)),
    ScanFormat(
        (ROWS,),
        "raw little-endian float32, n x 4, the fourth is the intensity; or n x m, with the columns' names: "
        '`application/vnd.firstfix.xyzi; columns="x,y,z,intensity,ring,time"`',
        _by(decode_xyzi),
        ".bin",
    ),
    ScanFormat(("application/x-pcd", "model/vnd.pcd"), "PCD", _by(decode_pcd), ".pcd", begins_as_pcd),
    ScanFormat(("application/ply", "model/ply"), "PLY", _by(decode_ply), ".ply", begins_with(b"ply")),
    ScanFormat(
        (CDR, ZENOH_CDR),
        "a ROS 2 message `sensor_msgs/msg/PointCloud2` as CDR",
        decode_cdr,
        begins=begins_with(b"\0\1\0\0"),  # little-endian; the other order's zeros may be a point
    ),
    ScanFormat(
        ("application/x-npy",), "NumPy's .npy: (n, m) numbers", _decode_npy, begins=begins_with(b"\x93NUMPY")
    ),
    ScanFormat(
        ("application/vnd.firstfix.query",),
        "a compact query, under 10 KB: some thousand points and the range view; or a descriptor alone, "
        "under 1.5 KB: [query.md](protocol/query.md)",
        _decode_compact,
        begins=begins_with(b"FFQY"),
    ),
    ScanFormat(
        ("application/vnd.firstfix.scans",),
        "several scans with the robot's motion between them: [scan.md](protocol/scan.md)",
        _decode_sequence,
        begins=begins_with(b"FFSS"),
    ),
    # The last: whatever is text and none of the others.
    ScanFormat(
        ("text/csv", "text/plain"), "rows of text: CSV, XYZ, PTS", _decode_text, begins=begins_as_text
    ),
)
MEDIA_TYPES = {name: each.decode for each in SCAN_FORMATS for name in each.media_types}
SUFFIXES = {each.suffix: each.media_types[0] for each in SCAN_FORMATS if each.suffix}
