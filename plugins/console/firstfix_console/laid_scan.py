"""A scan laid over a map version, as bytes: the work of a worker process."""

from __future__ import annotations

import numpy as np

from firstfix.engine.changes.overlay import OverlayMap
from firstfix.formats.point_cloud import Body
from firstfix.transform import Matrix
from firstfix_service.query_workers.look import Look

POINT = np.dtype([("at", "<f4", 3), ("kind", "<u4")])


def laid_over(T_map_sensor: Matrix, look: Look, body: Body) -> bytes:
    """The points of a scan at a pose, each as a ``POINT`` with what the map says.

    Args:
        T_map_sensor: (4, 4).
        body: without its content encoding.

    Raises:
        InputError: the body cannot be used.
        CorruptVersion: a file is missing or damaged.
    """
    assert look.directory is not None
    scan = look.body_format.decode(body)
    found = OverlayMap.load(look.directory).overlay(scan, T_map_sensor)
    packed = np.empty(len(found.kind), POINT)
    packed["at"], packed["kind"] = found.points, found.kind
    return packed.tobytes()
