"""Reader of LAS, LAZ and COPC files, for local files only: laspy believes the counts in them.

``laz_chunks.check_las`` makes files of others fit. The robot's distribution has no room for it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import FirstfixError, MalformedData, UnsupportedFormat
from .point_cloud import Limits, PointCloud

_POINTS_AT_ONCE = 2_000_000


def read_las(path: Path, limits: Limits, *, with_times: bool = False) -> PointCloud:
    """Read the columns x, y, z (float64, with scale and offset applied) and intensity of a file.

    Args:
        with_times: read gps_time too, where the points have it.

    Raises:
        MalformedData: the file is damaged or cut off.
        TooLarge: over the limits.
        UnsupportedFormat: laspy is not installed.
    """
    try:
        import laspy
    except ImportError as error:
        raise UnsupportedFormat("LAS: the package laspy[lazrs] is not installed") from error
    try:
        with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
            points = int(reader.header.point_count)
            limits.check("LAS", points, 8 * (5 if with_times else 4))
            if points > _POINTS_AT_ONCE:  # this backend takes memory for whole chunks
                reader.laz_backend = laspy.LazBackend.LazrsParallel
            has_times = with_times and "gps_time" in reader.header.point_format.dimension_names
            names = (*"xyz", "gps_time") if has_times else tuple("xyz")
            columns = {name: np.empty(points, np.float64) for name in names}
            intensity = np.empty(points, np.uint16)
            done = 0
            for chunk in reader.chunk_iterator(_POINTS_AT_ONCE):
                part = slice(done, done + len(chunk))
                for name in names:
                    columns[name][part] = chunk[name]
                intensity[part] = chunk.intensity
                done += len(chunk)
    except FirstfixError:
        raise
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a panic of the Rust backend is not an Exception
        raise MalformedData(f"LAS: {str(error) or type(error).__name__}") from error
    if done != points:
        raise MalformedData(f"LAS: the file is cut off: {done} of {points} points")
    return PointCloud({**columns, "intensity": intensity})
