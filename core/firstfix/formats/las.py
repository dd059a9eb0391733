"""LAS, LAZ and COPC through laspy. Its LAZ backend is not safe with bytes from strangers: files only."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import FirstfixError, MalformedData, UnsupportedFormat
from .point_cloud import Limits, PointCloud

_POINTS_AT_ONCE = 2_000_000


def read_las(path: Path, limits: Limits) -> PointCloud:
    """A file to its columns x, y, z (float64, scaled and offset) and intensity.

    Raises:
        MalformedData: damaged or cut off.
        TooLarge: over the limits.
        UnsupportedFormat: laspy is not installed.
    """
    try:
        import laspy
    except ImportError as error:
        raise UnsupportedFormat("LAS: reading it needs the package laspy[lazrs]") from error
    try:
        with laspy.open(path) as reader:
            points = int(reader.header.point_count)
            limits.check("LAS", points, 8 * 4)
            columns = {name: np.empty(points, np.float64) for name in "xyz"}
            intensity = np.empty(points, np.uint16)
            done = 0
            for chunk in reader.chunk_iterator(_POINTS_AT_ONCE):
                part = slice(done, done + len(chunk))
                for name in "xyz":
                    columns[name][part] = chunk[name]
                intensity[part] = chunk.intensity
                done += len(chunk)
    except FirstfixError:
        raise
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # the Rust backend's panics are no Exception
        raise MalformedData(f"LAS: {str(error) or type(error).__name__}") from error
    if done != points:
        raise MalformedData(f"LAS: {points} points are promised, {done} are there: cut off")
    return PointCloud({**columns, "intensity": intensity})
