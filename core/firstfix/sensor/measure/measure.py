"""Measures a sensor from its scans: beams, field of view, columns, range and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidScan
from ..model import SensorModel
from .nearest import nearest_presets
from .rings import Rings, Way, rings_by_elevation, rings_by_field, rings_by_order

MIN_POINTS = 500  # in all scans together
_ORIGIN_M = 0.02  # drivers write 0, 0, 0 where nothing returned
_BLIND_DEG = 20.0  # a larger gap of azimuth is the end of the field of view, and no open sky
_MAP_CELL_DEG = 1.0
_MAP_RATIO = 1.5  # of two ranges in one cell
_MAP_SHARE = 0.25  # of the points. A scan has one return in a direction, a map has all
_GRID_CELL_DEG = 3.0
_MAX_OF_SCAN = 300_000  # points: 128 beams at 2048 columns
_GRID_SLOPE = 1.0  # of a cell's points with range, as a power: 0 for a scan's rays, 2 for a grid's points
_COUNTS_DIFFER = 0.8
_SEEN_DIFFER = 0.6  # the same for rings that were told by elevation: in a deskewed scan some run together
_ROSETTE_ROW_DEG = 1.5  # between the rows that stand for a rosette, as in the Mid-360's preset
_STEP_BIN = 0.05  # of the logarithm of a gap between neighbours
_FLAT_STEP_M = 0.1  # between neighbours on one surface
_TRIPLES = 300  # fewer do not tell the noise
_STEP_DEG = (0.05, 10.0)  # the limits of a SensorModel
_STEEPEST_DEG = 89.9


@dataclass(frozen=True)
class MeasuredScan:
    """One scan to measure with.

    Attributes:
        name: for error messages.
        points: (n, 3) metres in the sensor frame, all finite.
        ring: (n,) as the format numbers the beams, or None.
        height_m: of the sensor above the floor, or None.
    """

    name: str
    points: NDArray[np.floating]
    ring: NDArray[np.integer] | None = None
    height_m: float | None = None


@dataclass(frozen=True)
class MeasuredSensor:
    """A sensor model that was measured from scans.

    Attributes:
        sensor: model for simulations.
        way: how rings were found; None: there are none, and the model has as many rays in the same field.
        presets: that look like it, the nearest first.
        scans, points: number of them.
        thinned: the points lie evenly in space: somebody has thinned them, and they do not tell the rays.
        floor_seen: whether ``mount_height_m`` was measured.
        noise_seen: whether ``range_noise_m`` was measured.
    """

    sensor: SensorModel
    way: Way | None
    presets: tuple[str, ...]
    scans: int
    points: int
    thinned: bool
    floor_seen: bool
    noise_seen: bool


def measure_sensor(
    scans: Sequence[MeasuredScan], name: str = "measured", default_height_m: float = 1.0
) -> MeasuredSensor:
    """Measure a sensor from scans of it, none of them moved or merged.

    Args:
        default_height_m: where no scan shows the floor.

    Raises:
        InvalidScan: too few points, a map and not a scan, or scans of different sensors.
    """
    views = [_View.of(scan) for scan in scans]
    total = sum(len(view) for view in views)
    if total < MIN_POINTS:
        raise InvalidScan(f"{total} points are too few to measure a sensor: it needs {MIN_POINTS} or more")
    for view in views:
        if view.share_behind() > _MAP_SHARE or (view.is_even() and len(view) > _MAX_OF_SCAN):
            raise InvalidScan(
                f"{view.name} is no scan of one sensor in its own frame, but a map or a merged cloud: many "
                "points lie behind others as seen from the origin, or evenly in space"
            )
    _check_one_sensor(views)
    way, elevations = _beams(views)
    fov_deg = _field_of_view_deg(views)
    steps = [step for view in views if (step := view.column_step_deg()) is not None]
    noises = [noise for view in views if (noise := view.noise_m()) is not None]
    heights = [scan.height_m for scan in scans if scan.height_m is not None]
    least_m = min(float(np.quantile(view.range_m, 0.001)) for view in views if len(view))
    most_m = max(float(view.range_m.max()) for view in views if len(view))
    if way is None or not steps:
        way, elevations = None, _rows_of(views, fov_deg)
        step_deg = fov_deg * len(elevations) / (total / len(views))
    else:
        step_deg = float(np.median(steps))
        fov_deg = min(360.0, fov_deg + step_deg)  # a column is one step wide
    sensor = SensorModel(
        name,
        tuple(round(float(up), 3) for up in np.clip(elevations, -_STEEPEST_DEG, _STEEPEST_DEG)),
        round(float(np.clip(step_deg, *_STEP_DEG)), 4),
        round(min(least_m, 100.0), 2),
        min(1000.0, float(np.floor(most_m)) + 1),
        round(float(np.median(heights)), 2) if heights else default_height_m,
        min(1.0, round(float(np.median(noises)), 3)) if noises else SensorModel.range_noise_m,
        pattern="rosette" if way is None else "rows",
        azimuth_fov_deg=round(max(fov_deg, float(np.clip(step_deg, *_STEP_DEG))), 1),
    )
    return MeasuredSensor(
        sensor,
        way,
        nearest_presets(sensor),
        scans=len(views),
        points=total,
        thinned=any(view.is_even() for view in views),
        floor_seen=bool(heights),
        noise_seen=bool(noises),
    )


@dataclass(frozen=True)
class _View:
    """A scan in polar form.

    Attributes:
        name: of the scan.
        azimuth_rad, elevation_deg, range_m: (n,).
        rings: by the format's field, else the elevation, else the order; None: it has none.
    """

    name: str
    azimuth_rad: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]
    range_m: NDArray[np.float64]
    rings: Rings | None

    def __len__(self) -> int:
        return len(self.range_m)

    @classmethod
    def of(cls, scan: MeasuredScan) -> _View:
        x, y, z = np.asarray(scan.points, np.float64).T
        level_m = np.hypot(x, y)
        range_m = np.hypot(level_m, z)
        used = range_m > _ORIGIN_M
        azimuth = np.arctan2(y, x)[used]
        elevation = np.degrees(np.arctan2(z, level_m))[used]
        range_m = range_m[used]
        rings = None
        if len(range_m) >= 2:
            if scan.ring is not None:
                rings = rings_by_field(elevation, range_m, scan.ring[used])
            rings = rings or rings_by_elevation(elevation, range_m)
            rings = rings or rings_by_order(elevation, range_m, azimuth)
        return cls(scan.name, azimuth, elevation, range_m, rings)

    def share_behind(self) -> float:
        """Share of points that lie far behind another one in nearly the same direction."""
        _, cell, count = self._cells(_MAP_CELL_DEG)
        nearest = np.full(len(count), np.inf)
        np.minimum.at(nearest, cell, self.range_m)
        return float((self.range_m > _MAP_RATIO * nearest[cell]).mean()) if len(cell) else 0.0

    def is_even(self) -> bool:
        """Whether the points lie evenly in space, as a grid leaves them, and not evenly in direction."""
        return self.rings is None and self._grid_slope() > _GRID_SLOPE

    def _grid_slope(self) -> float:
        """Power with which the points of a cell of direction rise with their range."""
        number, cell, count = self._cells(_GRID_CELL_DEG)
        if len(count) < 50:
            return 0.0
        mean_m = np.bincount(cell, self.range_m) / count
        up_deg = (number % 10_000 - 5_000 + 0.5) * _GRID_CELL_DEG
        density = np.log(count / np.cos(np.radians(up_deg)))
        x = np.log(mean_m)
        full = density > np.quantile(density, 0.3)  # cells at the edge of what returned are half empty
        return float(np.polyfit(x[full], density[full], 1, w=np.sqrt(count[full]))[0])

    def _cells(self, size_deg: float) -> tuple[NDArray[np.int64], NDArray[np.intp], NDArray[np.intp]]:
        """Numbers of the cells of direction with points, the (n,) cell of each point, and their counts."""
        across = np.floor(np.degrees(self.azimuth_rad) / size_deg).astype(np.int64) + 5_000
        up = np.floor(self.elevation_deg / size_deg).astype(np.int64) + 5_000
        number, cell, count = np.unique(across * 10_000 + up, return_inverse=True, return_counts=True)
        return number, cell, count

    def column_step_deg(self) -> float | None:
        """Angle between neighbours of a ring: the commonest gap, as the mean of those like it."""
        ring, azimuth_deg, _ = self._along_rings()
        gaps = np.diff(azimuth_deg)[np.diff(ring) == 0]
        gaps = gaps[gaps > 1e-3]  # else two returns in one direction
        if len(gaps) < 2:
            return None
        bins = np.floor(np.log(gaps) / _STEP_BIN).astype(np.intp)
        often = np.convolve(np.bincount(bins - bins.min()), np.ones(3), mode="same")
        usual = float(np.exp((np.argmax(often) + bins.min() + 0.5) * _STEP_BIN))
        return float(gaps[(gaps > usual * 0.7) & (gaps < usual * 1.4)].mean())

    def noise_m(self) -> float | None:
        """Noise of a range, from three neighbours of a ring on one flat surface; None: it cannot be told."""
        ring, _, range_m = self._along_rings()
        if len(ring) < 3:
            return None
        first, second = np.diff(range_m)[:-1], np.diff(range_m)[1:]
        flat = (ring[2:] == ring[:-2]) & (np.maximum(np.abs(first), np.abs(second)) < _FLAT_STEP_M)
        if flat.sum() < _TRIPLES:
            return None
        bent = (second - first)[flat]
        noise = float(np.median(np.abs(bent))) / 0.6745 / np.sqrt(6)  # of a normal distribution
        return noise if noise >= 0.0005 else None

    def _along_rings(self) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        """Ring, azimuth in degrees and range of the points that have a ring, ring by ring, by azimuth."""
        if self.rings is None:
            return np.zeros(0, np.intp), np.zeros(0), np.zeros(0)
        of_ring = np.flatnonzero(self.rings.of_point >= 0)
        order = of_ring[np.lexsort((self.azimuth_rad[of_ring], self.rings.of_point[of_ring]))]
        return self.rings.of_point[order], np.degrees(self.azimuth_rad[order]), self.range_m[order]


def _check_one_sensor(views: Sequence[_View]) -> None:
    """Refuse scans whose numbers of rings are too different for one sensor.

    Raises:
        InvalidScan: as said.
    """
    known = sorted((len(view.rings), view.name) for view in views if view.rings is not None)
    are_seen = any(view.rings.way == "elevation" for view in views if view.rings is not None)
    if known and known[0][0] < (_SEEN_DIFFER if are_seen else _COUNTS_DIFFER) * known[-1][0]:
        few, many = known[0], known[-1]
        raise InvalidScan(f"scans of different sensors: {few[1]} has {few[0]} rings, {many[1]} has {many[0]}")


def _beams(views: Sequence[_View]) -> tuple[Way | None, NDArray[np.float64]]:
    """How rings were found, and their elevations: the mean over the scans that show most of them."""
    known = [view.rings for view in views if view.rings is not None]
    if len(known) * 2 < len(views):
        return None, np.zeros(0)
    counts = [len(rings) for rings in known]
    usual = max(set(counts), key=lambda count: (counts.count(count), count))
    alike = [rings for rings in known if len(rings) == usual]
    elevations: NDArray[np.float64] = np.mean([rings.elevations_deg for rings in alike], axis=0)
    return alike[0].way, elevations


def _field_of_view_deg(views: Sequence[_View]) -> float:
    """Horizontal field of view."""
    azimuth_deg = np.sort(np.degrees(np.concatenate([view.azimuth_rad for view in views])))
    around = azimuth_deg[0] + 360 - azimuth_deg[-1]
    widest = max(float(np.diff(azimuth_deg).max(initial=0)), float(around))
    return 360.0 if widest < _BLIND_DEG else 360 - widest


def _rows_of(views: Sequence[_View], fov_deg: float) -> NDArray[np.float64]:
    """Elevations of rows that stand for the vertical field of view of a sensor without rings."""
    elevation = np.concatenate([view.elevation_deg for view in views])
    low, high = (
        float(np.clip(np.quantile(elevation, q), -_STEEPEST_DEG, _STEEPEST_DEG)) for q in (0.001, 0.999)
    )
    columns = fov_deg / _STEP_DEG[1]  # at least
    most = int(len(elevation) / len(views) / columns)
    return np.linspace(low, high, max(2, min(most, round((high - low) / _ROSETTE_ROW_DEG) + 1)))
