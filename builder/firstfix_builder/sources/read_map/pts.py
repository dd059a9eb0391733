"""PTS: points as text after a line with their number, or several such blocks, one a scan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.formats.text import decode_text

from ...mesh.intensity import Intensity, joined_intensity
from .map_data import MapData, finite_cloud
from .map_limits import LIMITS
from .text_lines import TextLines
from .what_was_read import WhatWasRead


def read_pts(path: Path) -> MapData:
    """All blocks as one cloud: they are in one frame.

    Raises:
        MalformedData: fewer points follow a number than it says, or they are no points.
        TooLarge: over the limits.
    """
    raw = path.read_bytes()
    first = raw.partition(b"\n")[0].strip()
    if not first.isdigit() or len(first) > 18 or raw.count(b"\n") <= int(first) + 1:
        points, intensity = finite_cloud(decode_text(raw, LIMITS))
        return MapData(points=points, intensity=intensity)
    lines = TextLines(raw)
    clouds: list[tuple[NDArray[np.float64], Intensity | None]] = []
    at = total = 0
    while at < len(lines):
        words = lines.words(at)
        if not words:
            at += 1
            continue
        if len(words) > 1 or not words[0].isdigit() or len(words[0]) > 18:
            raise MalformedData(
                f"PTS: line {at + 1} is {' '.join(words)[:60]!r}, where the number of points of block "
                f"{len(clouds) + 1} is expected"
            )
        count = int(words[0])
        left = len(lines) - at - 1
        if count > left:
            raise MalformedData(
                f"PTS: the file is cut off: {left} of {count} points of block {len(clouds) + 1}"
            )
        total += count
        LIMITS.check("PTS", total, 8 * 4)
        if count:
            clouds.append(finite_cloud(decode_text(lines.span(at, count + 1), LIMITS)))
        at += count + 1
    names = tuple(f"block {number}" for number in range(len(clouds)))
    if not clouds:
        raise MalformedData("PTS: its blocks have no points")
    return MapData(
        points=np.concatenate([points for points, _ in clouds]),
        intensity=joined_intensity([intensity for _, intensity in clouds]),
        read=WhatWasRead("PTS", clouds=names),
    )
