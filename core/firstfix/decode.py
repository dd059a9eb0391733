"""Decoding of request bodies to scans: by their media type, or by their own first bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from .errors import MalformedData, UnsupportedFormat
from .formats.point_cloud import Body
from .formats.raw_xyz import parse_columns
from .formats.signature import STRIPPED, is_stripped, media_type_of
from .ros.media_types import check_cloud_type
from .scan.sequence import AnyScan
from .scan_file import dataset_files_of
from .scan_formats import MEDIA_TYPES, ROWS, decode_cdr, decode_las, decode_named_rows

# Types that say nothing of the body: none, those of programs that do not know it, curl's own, and zenoh's.
GENERAL_TYPES = (
    "",
    "application/octet-stream",
    "binary/octet-stream",
    "application/x-www-form-urlencoded",
    "zenoh/bytes",
)


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
            UnsupportedFormat: as ``formats.signature.media_type_of``.
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
        if self.decode is not None:
            return self.decode
        return MEDIA_TYPES[media_type_of(body)]


def decode_query(body: Body, media_type: str) -> AnyScan:
    """The scan in a request body. Safe with bytes from strangers.

    Raises:
        UnsupportedFormat: as ``decoder_of``, and as ``formats.signature.media_type_of`` for a general type.
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
        UnsupportedFormat: unknown media type, a ROS message that is not a PointCloud2, or LAS where nothing
            here reads it.
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
    if decode is decode_las:
        dataset_files_of(".las").check_installed()
    columns = _columns_of(media_type) if name == ROWS else None
    return BodyDecoder(decode if columns is None else partial(decode_named_rows, columns))


def _columns_of(media_type: str) -> tuple[str, ...] | None:
    for parameter in media_type.split(";")[1:]:
        key, _, value = parameter.partition("=")
        if key.strip().lower() == "columns":
            return parse_columns(value.strip().strip('"'))
    return None
