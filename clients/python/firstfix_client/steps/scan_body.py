"""Encoding of scans for sending."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Union, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.errors import InvalidOption
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix.wire import sequence as wire_sequence

if TYPE_CHECKING:
    from firstfix.scan.descriptor_parameters import DescriptorParameters

# File readers and the code for compact queries are imported on use: most programs use neither.

ScanLike = Union[Scan, ArrayLike, "str | os.PathLike[str]"]
Encoding = Literal["scan", "range_image", "compact", "descriptor"]
MAX_COMPACT_BYTES = 10_000
MIN_POINTS = 500


def scan_of(scan: ScanLike) -> Scan:
    """The scan, made from points or read from a file if needed.

    Args:
        scan: a Scan, (n, >=3) points in metres in the sensor frame, or the path of a scan file.

    Raises:
        InvalidScan, TooLarge: the points are not those of a scan.
        InputError, NotFound: the file cannot be read.
    """
    if isinstance(scan, Scan):
        return scan
    if isinstance(scan, (str, os.PathLike)):
        from firstfix.scan_file import read_scan_file

        return read_scan_file(Path(scan))
    return Scan.from_points(scan)


@dataclass(frozen=True)
class BodyForm:
    """Form in which scans are sent.

    Attributes:
        encoding: ``scan``: all points; ``range_image``: a ninth to a third of the bytes; ``compact``: under
            MAX_COMPACT_BYTES, localizes as well; ``descriptor``: under 1.5 KB, gets candidates only.
        parameters: the map's. A descriptor needs them; a compact query does not.
        resolution_m, voxel_m: for whole scans, see ``firstfix.wire.scan.encode_scan``.
    """

    encoding: Encoding = "scan"
    parameters: DescriptorParameters | None = None
    resolution_m: float | None = None
    voxel_m: float | None = None


def encoded(
    scan: ScanLike | ScanSequence, form: BodyForm, gravity: NDArray[np.float64] | None = None
) -> tuple[str, bytes]:
    """Media type and body. The intensity is left out: localization does not use it.

    Raises:
        InvalidOption: unknown encoding; a descriptor without parameters, or for several scans.
        InputError, NotFound: see ``scan_of``.
    """
    if form.encoding not in get_args(Encoding):
        raise InvalidOption(f"encoding must be one of {', '.join(get_args(Encoding))}, not {form.encoding!r}")
    if isinstance(scan, ScanSequence):
        if form.encoding == "descriptor":
            raise InvalidOption(
                "several scans cannot be sent as descriptors: their points are needed for registration"
            )
        scans = [
            _part(one, form, None if gravity is None else T_last_scan[:3, :3].T @ gravity)
            for one, T_last_scan in zip(scan.scans, scan.T_last_scan, strict=True)
        ]
        return wire_sequence.MEDIA_TYPE, wire_sequence.encode_scans(
            scans, scan.T_last_scan, **_of_whole_scans(form)
        )
    one = scan_of(scan)
    if form.encoding == "compact":
        from firstfix.scan.condense import condense

        return wire_query.MEDIA_TYPE, _compact_body(condense(one, form.parameters, gravity))
    if form.encoding == "descriptor":
        from firstfix.scan.condense import describe

        if form.parameters is None:
            raise InvalidOption(
                "a descriptor needs the parameters of the map: DescriptorParameters.from_engine"
            )
        return wire_query.MEDIA_TYPE, wire_query.encode_query(describe(one, form.parameters, gravity))
    plain = replace(one, intensity=None)
    return wire.MEDIA_TYPE, wire.encode_scan(plain, **_of_whole_scans(form))


def _of_whole_scans(form: BodyForm) -> dict[str, Any]:
    """The arguments for ``wire.encode_scan``."""
    chosen = "range_image" if form.encoding == "range_image" else "points"
    return {"form": chosen, "resolution_m": form.resolution_m, "voxel_m": form.voxel_m}


def _part(
    scan: Scan | CompactScan, form: BodyForm, gravity: NDArray[np.float64] | None
) -> Scan | CompactScan:
    """One of several scans in the form to send. Gravity is in this scan's own frame."""
    if isinstance(scan, CompactScan):
        return scan
    if form.encoding != "compact":
        return replace(scan, intensity=None)
    from firstfix.scan.condense import condense

    return condense(scan, form.parameters, gravity)


def _compact_body(scan: CompactScan) -> bytes:
    """The body. A scan with too many bytes loses points, down to MIN_POINTS."""
    body = wire_query.encode_query(scan)
    while len(body) >= MAX_COMPACT_BYTES and len(scan) > MIN_POINTS:
        kept = rows_by_chance(len(scan), len(scan) * 9 // 10)
        time_s = None if scan.time_s is None else scan.time_s[kept]
        scan = replace(scan, points=scan.points[kept], time_s=time_s)
        body = wire_query.encode_query(scan)
    return body
