"""Reader of LAS, LAZ and COPC files, for local files only: laspy believes the counts in them.

``laz_chunks.check_las`` makes files of others fit. The robot's distribution has no room for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FirstfixError, MalformedData, UnsupportedFormat
from .point_cloud import Limits, PointCloud

_POINTS_AT_ONCE = 2_000_000
_LOW_NOISE, _HIGH_NOISE = 7, 18  # classes


@dataclass(frozen=True)
class LasCloud(PointCloud):
    """The points of a file that count.

    Attributes:
        withheld: number of points that were left out as withheld, which stands for deleted.
        noise: number of those that were left out by their class.
    """

    withheld: int = 0
    noise: int = 0


def read_las(path: Path, limits: Limits, *, with_times: bool = False) -> LasCloud:
    """Read the columns x, y, z (float64, with scale and offset applied) and intensity of a file.

    Points that are withheld, or classed as noise, are left out (LAS 1.4 R15, tables 8 and 17).

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
            read = done = withheld = noise = 0
            for chunk in reader.chunk_iterator(_POINTS_AT_ONCE):
                read += len(chunk)
                is_withheld, kinds = np.asarray(chunk.withheld, bool), np.asarray(chunk.classification)
                left_out = (kinds == _LOW_NOISE) | (kinds == _HIGH_NOISE) | is_withheld
                keep = None
                if left_out.any():
                    keep = ~left_out
                    withheld += int(is_withheld.sum())
                    noise += int((left_out & ~is_withheld).sum())
                brightness = _kept(chunk.intensity, keep)
                part = slice(done, done + len(brightness))
                intensity[part] = brightness
                for name in names:
                    columns[name][part] = _kept(chunk[name], keep)
                done += len(brightness)
    except FirstfixError:
        raise
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a panic of the Rust backend is not an Exception
        raise MalformedData(f"LAS: {str(error) or type(error).__name__}") from error
    if read != points:
        raise MalformedData(f"LAS: the file is cut off: {read} of {points} points")
    if points and not done:
        raise MalformedData(f"LAS: all its {points} points are withheld, or classed as noise")
    told: dict[str, NDArray[Any]] = {**columns, "intensity": intensity}
    return LasCloud({name: column[:done] for name, column in told.items()}, withheld, noise)


def _kept(column: Any, keep: NDArray[np.bool_] | None) -> NDArray[Any]:
    """Numbers of the points that are kept; of all without a copy."""
    numbers = np.asarray(column)
    return numbers if keep is None else numbers[keep]
