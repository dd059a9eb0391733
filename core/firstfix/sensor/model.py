"""A sensor model: the rays of a LiDAR and its mounting, for the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from difflib import get_close_matches
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidOption
from ..scan.levelling import MAX_TILT_DEG, turned
from ..transform import rotation_z
from .presets import PRESETS
from .rosette import MOMENTS, rosette

Pattern = Literal["rows", "rosette"]
MIN_FAN_DEG = 15.0  # between headings of a sensor on its side, even if its beams are narrower


@dataclass(frozen=True)
class SensorModel:
    """Spinning LiDAR, or one like it: every beam elevation at every azimuth.

    Attributes:
        name: of the preset, or the user's own.
        elevations_deg: one for each beam, in any order, within (-90, 90).
        azimuth_step_deg: angle between columns.
        min_range_m, max_range_m: returns outside are not reported.
        mount_height_m: height of the sensor above the floor that the robot drives on.
        range_noise_m: standard deviation of a range.
        mount_roll_deg, mount_pitch_deg: mounting on a robot that stands level: roll about x, then pitch about
            y. With roll 180 the sensor hangs head down.
        pattern: of a scan. "rows": every elevation at every azimuth. "rosette": as many rays between the
            lowest and the highest elevation, as a Mid-360 casts them. Each scan has others.
        azimuth_fov_deg: horizontal field of view, its middle ahead (x). A scan sees no more; templates look
            all around, because they are made for all headings.
    """

    name: str
    elevations_deg: tuple[float, ...]
    azimuth_step_deg: float
    min_range_m: float
    max_range_m: float
    mount_height_m: float
    range_noise_m: float = 0.02
    mount_roll_deg: float = 0.0
    mount_pitch_deg: float = 0.0
    pattern: Pattern = "rows"
    azimuth_fov_deg: float = 360.0

    def __post_init__(self) -> None:
        elevations = np.asarray(self.elevations_deg, np.float64)
        checks = {
            "elevations_deg": 1 <= elevations.size <= 512 and bool((np.abs(elevations) < 90).all()),
            "azimuth_step_deg": 0.05 <= self.azimuth_step_deg <= 10,
            "min_range_m": 0 <= self.min_range_m <= 100,
            "max_range_m": self.min_range_m < self.max_range_m <= 1000,
            "mount_height_m": 0 <= self.mount_height_m <= 100,
            "range_noise_m": 0 <= self.range_noise_m <= 1,
            "mount_roll_deg": abs(self.mount_roll_deg) <= 180,
            "mount_pitch_deg": abs(self.mount_pitch_deg) <= 180,
            "pattern": self.pattern in get_args(Pattern),
            "azimuth_fov_deg": self.azimuth_step_deg <= self.azimuth_fov_deg <= 360,
        }
        for name, ok in checks.items():
            if not ok:
                raise InvalidOption(f"sensor {self.name!r}: {name} = {getattr(self, name)!r} is out of range")

    def directions(self) -> NDArray[np.float32]:
        """Unit rays (beams * columns, 3) in the sensor frame, beam by beam: all that the sensor can see.

        They are rows whatever the pattern, because a template shows the whole field of view.
        """
        azimuth = np.linspace(-np.pi, np.pi, self._columns, endpoint=False)
        elevation = np.radians(self.elevations_deg)
        return _unit(*np.meshgrid(elevation, azimuth, indexing="ij"))

    @property
    def moments(self) -> int:
        """Number of different scans that ``scan_directions`` knows."""
        return MOMENTS if self.pattern == "rosette" else 1

    @property
    def looks_around(self) -> bool:
        """Whether one scan has the rays of ``directions``: rows, all around."""
        return self.pattern == "rows" and self.azimuth_fov_deg == 360

    def scan_directions(self, moment: int = 0) -> NDArray[np.float32]:
        """Unit rays (beams * columns within the field of view, 3) of one scan in the sensor frame.

        Args:
            moment: 0 to ``moments - 1``, when the scan begins.
        """
        if self.looks_around:
            return self.directions()
        share = self.azimuth_fov_deg / 360
        columns = round(self._columns * share)
        if self.pattern == "rows":
            half = np.radians(self.azimuth_fov_deg) / 2
            azimuth = np.linspace(-half, half, columns, endpoint=False) + half / columns
            return _unit(*np.meshgrid(np.radians(self.elevations_deg), azimuth, indexing="ij"))
        low_deg, high_deg = min(self.elevations_deg), max(self.elevations_deg)
        azimuth, elevation = rosette(low_deg, high_deg, len(self.elevations_deg) * columns, moment)
        return _unit(elevation, azimuth if share == 1 else azimuth * share)

    @property
    def _columns(self) -> int:
        return round(360 / self.azimuth_step_deg)

    @property
    def R_base_sensor(self) -> NDArray[np.float64]:
        """(3, 3) mounting: from the sensor frame to the frame of a robot that stands level."""
        roll, pitch = np.radians([self.mount_roll_deg, self.mount_pitch_deg])
        about_x = [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
        about_y = [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
        return np.array(about_y) @ np.array(about_x)

    def directions_at_any_heading(self) -> NDArray[np.float32]:
        """Unit rays (beams * columns, 3) in the frame of a level robot, covering all headings.

        A sensor that stands upright or hangs head down sees all around at one heading. One that sits on its
        side does not: its rays are distributed over enough headings to see all around.
        """
        rays = turned(self.directions(), self.R_base_sensor)
        if abs(self.R_base_sensor[2, 2]) >= np.cos(np.radians(MAX_TILT_DEG)):
            return rays
        headings = int(np.ceil(360 / max(np.ptp(self.elevations_deg), MIN_FAN_DEG)))
        for number, yaw in enumerate(np.linspace(0, 2 * np.pi, headings, endpoint=False)):
            rays[number::headings] = turned(rays[number::headings], rotation_z(yaw))
        return rays

    def coarser(self, max_rays: int) -> SensorModel:
        """Model with the same field of view and fewer rays, which keeps the simulation of templates cheap."""
        beams, columns = len(self.elevations_deg), self._columns
        if beams * columns <= max_rays:
            return self
        columns = min(columns, max(360, max_rays // beams))
        keep = max(1, min(beams, max_rays // columns))
        order = np.sort(np.asarray(self.elevations_deg))
        chosen = order[np.unique(np.round(np.linspace(0, beams - 1, keep)).astype(int))]
        return replace(self, elevations_deg=tuple(float(v) for v in chosen), azimuth_step_deg=360 / columns)

    def to_mapping(self) -> dict[str, Any]:
        """Values by name, ready for JSON or YAML."""
        return {**asdict(self), "elevations_deg": list(self.elevations_deg)}

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> SensorModel:
        """Model from a YAML or JSON mapping; ``preset: NAME`` takes other values from a preset.

        Raises:
            InvalidOption: an unknown key, a missing key, or a value out of range.
        """
        values = dict(data)
        base = preset(str(values.pop("preset"))) if "preset" in values else None
        unknown = set(values) - {f.name for f in fields(cls)}
        if unknown:
            raise InvalidOption(f"unknown key of a sensor: {', '.join(sorted(unknown))}")
        try:
            if "elevations_deg" in values:
                values["elevations_deg"] = tuple(float(v) for v in values["elevations_deg"])
            return replace(base, **values) if base else cls(**values)
        except (TypeError, ValueError) as error:
            raise InvalidOption(f"sensor model: {error}") from error


def _unit(elevation: NDArray[np.float64], azimuth: NDArray[np.float64]) -> NDArray[np.float32]:
    """Angles in radians, of any shape, to unit vectors (n, 3)."""
    level = np.cos(elevation)
    rays = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
    return np.ascontiguousarray(rays.reshape(-1, 3), np.float32)


def presets() -> list[str]:
    """Names of the presets, sorted."""
    return sorted(PRESETS)


def preset(name: str) -> SensorModel:
    """Sensor model of a common LiDAR, by its name in upper or lower case.

    Raises:
        InvalidOption: no preset has this name.
    """
    try:
        return SensorModel(name.lower(), **PRESETS[name.lower()])
    except KeyError:
        raise InvalidOption(f"no sensor preset {name!r}; {_meant(name)}") from None


def _meant(name: str) -> str:
    """Presets to give in place of an unknown one: those with a similar name, or all."""
    plain = {preset.replace("-", ""): preset for preset in presets()}
    near = get_close_matches(name.lower().replace("-", "").replace("_", ""), plain, 3, cutoff=0.7)
    if near:
        return f"did you mean {' or '.join(plain[one] for one in near)}? Or give the path of a YAML file"
    return f"there are {', '.join(presets())}, or give the path of a YAML file"
