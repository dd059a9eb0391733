"""3DTK's .3d scans: text in centimetres, left-handed, x right, y up, z forward."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firstfix.formats.point_cloud import MAP_LIMITS
from firstfix.formats.text import decode_text

from .local_frame import finite_points
from .map_data import MapData


def read_uos(path: Path) -> MapData:
    """One scan, in its own frame turned to REP-103 metres. Raises MalformedData or TooLarge."""
    x, y, z = decode_text(path.read_bytes(), MAP_LIMITS).xyz.T
    return MapData(points=finite_points(np.stack([z, -x, y], axis=1) / 100.0))
