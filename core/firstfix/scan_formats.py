"""The formats of scans: one table of media types, signatures and decoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from .formats.pcd import decode_pcd
from .formats.ply import decode_ply
from .formats.point_cloud import SCAN_LIMITS, Body, Limits, PointCloud
from .formats.raw_xyz import decode_rows, decode_xyz, decode_xyzi
from .ros.media_types import CDR, ZENOH_CDR
from .ros.point_cloud2 import decode_point_cloud2
from .scan.scan import Scan
from .scan.sequence import AnyScan, ScanSequence
from .scan_file import dataset_files_of, scan_of_cloud

ROWS = "application/vnd.firstfix.xyzi"
LAS = ("application/vnd.las", "application/vnd.laszip")


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


def decode_las(body: Body) -> Scan:
    """The scan in a LAS or LAZ file, which a confined process reads."""
    return scan_of_cloud(dataset_files_of(".las").decode_las_confined(body, SCAN_LIMITS))


def _decode_cloud(decode: Callable[[Body, Limits], PointCloud], body: Body) -> Scan:
    return scan_of_cloud(decode(body, SCAN_LIMITS))


def decode_named_rows(columns: tuple[str, ...], body: Body) -> Scan:
    """The scan in rows of float32 with these columns."""
    return scan_of_cloud(decode_rows(body, columns, SCAN_LIMITS))


def _by(decode: Callable[[Body, Limits], PointCloud]) -> Callable[[Body], Scan]:
    return partial(_decode_cloud, decode)


@dataclass(frozen=True)
class ScanFormat:
    """A format of scans.

    Attributes:
        media_types: the first is the one to send; the others mean the same.
        encoding: the format in the words of clients/PROTOCOL.md.
        decode: makes a scan of a body. It can be pickled.
        suffixes: endings of files that clients send without change, the first that of a saved body.
    """

    media_types: tuple[str, ...]
    encoding: str
    decode: Callable[[Body], AnyScan]
    suffixes: tuple[str, ...] = ()


# What is told elsewhere is made from these rows: `python scripts/generate.py`.
SCAN_FORMATS = (
    ScanFormat(
        ("application/vnd.firstfix.scan",),
        "compressed, as points or as a [range image](protocol/range-image.md): [scan.md](protocol/scan.md)",
        decode_wire,
        (".ffscan",),
    ),
    ScanFormat(("application/vnd.firstfix.xyz",), "raw little-endian float32, n x 3", _by(decode_xyz)),
    ScanFormat(
        (ROWS,),
        "raw little-endian float32, n x 4, the fourth is the intensity; or n x m, with the columns' names: "
        '`application/vnd.firstfix.xyzi; columns="x,y,z,intensity,ring,time"`',
        _by(decode_xyzi),
        (".bin",),
    ),
    ScanFormat(("application/x-pcd", "model/vnd.pcd"), "PCD", _by(decode_pcd), (".pcd",)),
    ScanFormat(("application/ply", "model/ply"), "PLY", _by(decode_ply), (".ply",)),
    ScanFormat(
        (CDR, ZENOH_CDR),
        "a ROS 2 message `sensor_msgs/msg/PointCloud2` as CDR",
        decode_cdr,
    ),
    ScanFormat(("application/x-npy",), "NumPy's .npy: (n, m) numbers", _decode_npy, (".npy",)),
    ScanFormat(
        ("application/vnd.firstfix.query",),
        "a compact query, under 10 KB: some thousand points and the range view; or a descriptor alone, "
        "under 1.5 KB: [query.md](protocol/query.md)",
        _decode_compact,
    ),
    ScanFormat(
        ("application/vnd.firstfix.scans",),
        "several scans with the robot's motion between them: [scan.md](protocol/scan.md)",
        _decode_sequence,
    ),
    ScanFormat(
        LAS,
        "LAS and LAZ, by a confined process, where the builder is installed",
        decode_las,
        (".las", ".laz"),
    ),
    ScanFormat(
        ("text/csv", "text/plain"),
        "rows of text: CSV, XYZ, PTS",
        _decode_text,
        (".csv", ".xyz", ".txt", ".pts"),
    ),
)
MEDIA_TYPES = {name: each.decode for each in SCAN_FORMATS for name in each.media_types}
SUFFIXES = {suffix: each.media_types[0] for each in SCAN_FORMATS for suffix in each.suffixes}
