"""Format of a query body: the way from its bytes to a scan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firstfix.decode import decoder_of, is_point_cloud2
from firstfix.scan.sequence import AnyScan
from firstfix.wire.content_encoding import decompressor_of


@dataclass(frozen=True)
class BodyFormat:
    """Decompressor and decoder of one body. The service chooses them, a worker process applies them."""

    decompress: Callable[[bytes, int], bytes]
    decode: Callable[[bytes], AnyScan]

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

    def scan_of(self, body: bytes, max_decoded_bytes: int) -> AnyScan:
        """Returns the scan in a body.

        Raises:
            MalformedData, TooLarge, InvalidScan: as the decompressor and the decoder say.
        """
        return self.decode(self.decompress(body, max_decoded_bytes))
