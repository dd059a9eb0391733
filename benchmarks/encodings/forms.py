"""The ways to send a scan that are compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from firstfix.scan.condense import condense, describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.wire import scan as wire
from firstfix.wire.query import MEDIA_TYPE, encode_query

Encode = Callable[[Scan, DescriptorParameters], bytes]


@dataclass(frozen=True)
class Form:
    """One way to send a scan.

    Attributes:
        encode: from a scan and what is known of the map; None: the scan is asked as it is.
    """

    name: str
    encode: Encode | None
    media_type: str = MEDIA_TYPE


def _whole(voxel_m: float | None) -> Encode:
    return lambda scan, known: wire.encode_scan(replace(scan, intensity=None), voxel_m=voxel_m)


def _image(resolution_m: float | None = None) -> Encode:
    return lambda scan, known: wire.encode_scan(scan, form="range_image", resolution_m=resolution_m)


def _any_map(points: int, resolution_m: float) -> Encode:
    return lambda scan, known: encode_query(condense(scan, points=points), resolution_m=resolution_m)


def _this_map(scan: Scan, known: DescriptorParameters) -> bytes:
    return encode_query(condense(scan, known))


def _descriptor(scan: Scan, known: DescriptorParameters) -> bytes:
    return encode_query(describe(scan, known))


RAW = Form("the scan itself", None)
COMPACT = Form("compact: 2500 points, 2 cm", _any_map(2500, 0.02))
DESCRIPTOR = Form("descriptor", _descriptor)
FORMS = (
    RAW,
    Form("scan, 1 cm", _whole(None), wire.MEDIA_TYPE),
    Form("scan, 1 cm, a point each 0.25 m", _whole(0.25), wire.MEDIA_TYPE),
    Form("range image, 2.5 cm", _image(), wire.MEDIA_TYPE),
    *(Form(f"range image, {cm} cm", _image(cm / 100), wire.MEDIA_TYPE) for cm in (1, 5, 10)),
    COMPACT,
    Form("compact, the map known, with descriptor", _this_map),
    *(Form(f"compact: {n} points", _any_map(n, 0.02)) for n in (500, 1000, 2000, 4000)),
    *(Form(f"compact: {cm} cm", _any_map(2500, cm / 100)) for cm in (1, 3, 5)),
    DESCRIPTOR,
)
QUICK = (RAW, COMPACT, DESCRIPTOR)
