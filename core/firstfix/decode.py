"""Decoding of request bodies and files to scans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from .errors import InputError, InvalidOption, MalformedData, NotFound, TooLarge, UnsupportedFormat
from .formats.file_kind import SNIFFED_BYTES
from .formats.pcd import decode_pcd
from .formats.ply import decode_ply
from .formats.point_cloud import SCAN_LIMITS, Body, Limits, PointCloud
from .formats.raw_xyz import parse_columns
from .formats.signature import no_signature
from .formats.text_mode import STRIPPED, is_stripped
from .ros.media_types import check_cloud_type
from .scan.scan import Scan
from .scan.sequence import AnyScan
from .scan_formats import (
    GENERAL_TYPES,
    MEDIA_TYPES,
    ROWS,
    SCAN_FORMATS,
    SUFFIXES,
    ScanFormat,
    dataset_files_of,
    decode_cdr,
    decode_named_rows,
    decode_wire,
    scan_of_cloud,
)

MAX_SCAN_FILE_BYTES = 1_000_000_000
READABLE = (*SUFFIXES, ".npy", ".xyz", ".txt", ".pts", ".csv", ".las", ".laz")
_CLOUD_FILES: dict[str, Callable[[Body, Limits], PointCloud]] = {".pcd": decode_pcd, ".ply": decode_ply}
_Read = TypeVar("_Read")


@dataclass(frozen=True)
class BodyDecoder:
    """The decoder of the bodies of one request. It can be pickled.

    Attributes:
        decode: makes a scan of a body; None: each body's signature decides.
    """

    decode: Callable[[Body], AnyScan] | None

    def __call__(self, body: Body) -> AnyScan:
        """The scan in a body without its content encoding. Safe with bytes from strangers.

        Raises:
            UnsupportedFormat: as ``format_by_signature``.
            MalformedData, TooLarge, InvalidScan: as the decoder says.
        """
        try:
            return self._of(body)(body)
        except MalformedData as error:
            if is_stripped(body):
                raise MalformedData(f"{error}. {STRIPPED}") from error
            raise

    def is_point_cloud2(self, body: Body) -> bool:
        """Whether a body that was decoded is a ROS PointCloud2, which has a stamp."""
        return self._of(body) is decode_cdr

    def _of(self, body: Body) -> Callable[[Body], AnyScan]:
        return format_by_signature(body).decode if self.decode is None else self.decode


def decode_query(body: Body, media_type: str) -> AnyScan:
    """The scan in a request body. Safe with bytes from strangers.

    Raises:
        UnsupportedFormat: as ``decoder_of``, and as ``format_by_signature`` for a general type.
        MalformedData, TooLarge, InvalidScan: as the decoder says.
    """
    return decoder_of(media_type)(body)


def decoder_of(media_type: str) -> BodyDecoder:
    """The decoder of a media type.

    Args:
        media_type: one of MEDIA_TYPES, in any case, or one of GENERAL_TYPES: then the body's own signature
            decides. Parameters after a semicolon are ignored, except the message type of CDR, and the columns
            of raw rows.

    Raises:
        UnsupportedFormat: unknown media type, or a ROS message that is not a PointCloud2.
        InvalidOption: columns that are none.
    """
    name = media_type.split(";", 1)[0].strip().lower()
    if name in GENERAL_TYPES:
        return BodyDecoder(None)
    decode = MEDIA_TYPES.get(name)
    if decode is None:
        raise UnsupportedFormat(
            f"unknown media type {name[:80]!r} of a scan: use one of {', '.join(MEDIA_TYPES)}"
        )
    if decode is decode_cdr:
        check_cloud_type(media_type)
    columns = _columns_of(media_type) if name == ROWS else None
    return BodyDecoder(decode if columns is None else partial(decode_named_rows, columns))


def format_by_signature(body: Body) -> ScanFormat:
    """The format of a body without its content encoding, by its first bytes.

    Raises:
        MalformedData: the body is empty.
        UnsupportedFormat: they are of no format of scans, or of one without a signature, as raw rows are.
    """
    head = bytes(body[:SNIFFED_BYTES])
    found = next((each for each in SCAN_FORMATS if each.begins is not None and each.begins(head)), None)
    if found is None:
        raise no_signature(head, MEDIA_TYPES)
    return found


def _columns_of(media_type: str) -> tuple[str, ...] | None:
    for parameter in media_type.split(";")[1:]:
        key, _, value = parameter.partition("=")
        if key.strip().lower() == "columns":
            return parse_columns(value.strip().strip('"'))
    return None


def read_scan_file(path: Path, columns: tuple[str, ...] | None = None) -> Scan:
    """Read a scan from a local file. The ending of the name selects the format.

    It reads the endings of SUFFIXES, .bin of data sets, .npy, .xyz, .txt, .pts, .csv, and, with laspy,
    .las and .laz. For local files only: LAZ decoders are not safe for untrusted input.

    Args:
        columns: names of the columns of a .bin's rows of float32, as ``("x", "y", "z", "_", "ring")``; ``_``
            is left out. None: told by evidence.

    Raises:
        NotFound: no such file.
        InputError: a subclass; the message names the file.
    """
    return _named(Path(path), partial(_read_scan_file, columns=columns))


def read_cloud_file(path: Path, columns: tuple[str, ...] | None = None) -> PointCloud:
    """Read the columns of a scan's file, all that the format has: beams, too. As ``read_scan_file`` does.

    Raises:
        NotFound, InputError: as there.
    """
    return _named(Path(path), partial(_read_cloud_file, columns=columns))


def _named(path: Path, read: Callable[[Path], _Read]) -> _Read:
    """Read a file; an error names it."""
    try:
        return read(path)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    except FileNotFoundError as error:
        raise NotFound(f"{path}: no such file") from error


def _read_scan_file(path: Path, columns: tuple[str, ...] | None) -> Scan:
    if path.suffix.lower() == ".ffscan":
        _check_file(path)
        return decode_wire(path.read_bytes())
    return scan_of_cloud(_read_cloud_file(path, columns))


def _read_cloud_file(path: Path, columns: tuple[str, ...] | None) -> PointCloud:
    suffix = _check_file(path)
    if columns is not None and suffix != ".bin":
        raise InvalidOption("columns are for .bin: the other formats say theirs")
    if suffix == ".ffscan":
        points = decode_wire(path.read_bytes()).points
        return PointCloud(dict(zip("xyz", points.T, strict=True)))
    if suffix in _CLOUD_FILES:
        return _CLOUD_FILES[suffix](path.read_bytes(), SCAN_LIMITS)
    return dataset_files_of(suffix).read_dataset_file(path, columns)


def _check_file(path: Path) -> str:
    """The ending of a scan's file."""
    suffix = path.suffix.lower()
    if path.is_dir():
        raise UnsupportedFormat("this is a folder, not the file of a scan")
    if suffix not in READABLE:
        ending = f"that end in {suffix!r}" if suffix else "without an ending"
        raise UnsupportedFormat(f"scans cannot be read from files {ending}: use {', '.join(READABLE)}")
    size = path.stat().st_size
    if size > MAX_SCAN_FILE_BYTES:
        raise TooLarge(f"{size} bytes, the limit is {MAX_SCAN_FILE_BYTES}")
    if size == 0:
        raise MalformedData("the file is empty (0 bytes)")
    return suffix
