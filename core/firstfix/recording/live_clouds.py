"""Clouds of live messages other than PointCloud2, for a gateway: by the decoders of recordings.

The robot's distribution leaves this module out: a gateway that needs it has firstfix itself.
"""

from __future__ import annotations

from ..formats.point_cloud import Limits
from ..ros.point_cloud2 import StampedCloud
from . import compressed_cloud, livox
from .clouds import Decode
from .messages import CDR, RawMessage

DECODERS: dict[str, Decode] = {
    compressed_cloud.TYPE: compressed_cloud.compressed_decoder(),
    **dict.fromkeys(livox.TYPES, livox.decode_livox),
}


def decode_live_cloud(ros_type: str, body: bytes, limits: Limits) -> StampedCloud:
    """Decode a serialised message of one of DECODERS.

    Raises:
        MalformedData, TooLarge, UnsupportedFormat: as its decoder says.
        ModuleNotFoundError: a package that its format needs is not installed.
    """
    return DECODERS[ros_type](RawMessage("", 0, body, ros_type, CDR), limits)
