"""Format of a query body: the way from its bytes to a scan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firstfix.decode import decoder_of, is_point_cloud2
from firstfix.formats.point_cloud import Body
from firstfix.scan.sequence import AnyScan
from firstfix.wire.content_encoding import decompressor_of

__all__ = ["Body", "BodyFormat"]


@dataclass(frozen=True)
class BodyFormat:
    """Decompressor and decoder of one body. The service chooses them, a worker process applies them.

    Attributes:
        decompress: of a body, up to so many bytes.
            Raises MalformedData or TooLarge.
        decode: of a body without its content encoding.
            Raises MalformedData, TooLarge or InvalidScan.
    """

    decompress: Callable[[Body, int], Body]
    decode: Callable[[Body], AnyScan]

    @classmethod
    def of(cls, media_type: str, content_encoding: str | None) -> BodyFormat:
        """Returns the format that the headers name.

        Raises:
            UnsupportedFormat: unknown media type or content encoding.
        """
        return cls(decompressor_of(content_encoding or ""), decoder_of(media_type))

    @property
    def is_point_cloud2(self) -> bool:
        """True for a ROS PointCloud2, which has a stamp."""
        return is_point_cloud2(self.decode)
