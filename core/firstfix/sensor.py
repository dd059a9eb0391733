"""Sensor models: the rays of a LiDAR and its mounting, for the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidOption
from .scan.levelling import MAX_TILT_DEG, turned
from .transform import rotation_z

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
        }
        for name, ok in checks.items():
            if not ok:
                raise InvalidOption(f"sensor {self.name!r}: {name} = {getattr(self, name)!r} is out of range")

    def directions(self) -> NDArray[np.float32]:
        """Unit rays (beams * columns, 3) in the sensor frame, beam by beam."""
        columns = round(360 / self.azimuth_step_deg)
        azimuth = np.linspace(-np.pi, np.pi, columns, endpoint=False)
        elevation = np.radians(self.elevations_deg)
        e, a = np.meshgrid(elevation, azimuth, indexing="ij")
        rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
        return np.ascontiguousarray(rays.reshape(-1, 3), np.float32)

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
        beams, columns = len(self.elevations_deg), round(360 / self.azimuth_step_deg)
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


def _even(low_deg: float, high_deg: float, beams: int) -> tuple[float, ...]:
    return tuple(round(float(v), 4) for v in np.linspace(low_deg, high_deg, beams))


# The HDL-64E has two blocks of 32: 1/3 degree apart above -8.83, 1/2 degree below (Velodyne's manual).
_HDL64 = tuple(round(2.0 - i / 3, 4) for i in range(32)) + tuple(round(-8.83 - i / 2, 4) for i in range(32))
# The OS0 and OS1 are evenly spaced to within 0.3 degrees; real units ship their own calibration.
_PRESETS = {
    model.name: model
    for model in (
        SensorModel("vlp-16", _even(-15, 15, 16), 0.2, 0.5, 100, 0.6),
        SensorModel("hdl-32e", _even(-30.67, 10.67, 32), 0.2, 1.0, 100, 1.0),
        SensorModel("hdl-64e", _HDL64, 0.2, 1.5, 120, 1.73),
        SensorModel("os0-64", _even(-45, 45, 64), 360 / 1024, 0.3, 50, 1.0),
        SensorModel("os0-128", _even(-45, 45, 128), 360 / 1024, 0.3, 50, 1.0),
        SensorModel("os1-64", _even(-22.5, 22.5, 64), 360 / 1024, 0.3, 120, 1.0),
        SensorModel("os1-128", _even(-22.5, 22.5, 128), 360 / 1024, 0.3, 120, 1.0),
        SensorModel("xt32", _even(-16, 15, 32), 0.18, 0.3, 120, 0.8),
        # Not a spinning scanner: a rosette that fills this band; 40 rows stand for 0.1 s of it.
        SensorModel("mid-360", _even(-7, 52, 40), 0.72, 0.2, 70, 0.5),
    )
}


def presets() -> list[str]:
    """Names of the presets, sorted."""
    return sorted(_PRESETS)


def preset(name: str) -> SensorModel:
    """Sensor model of a common LiDAR, by its name in upper or lower case.

    Raises:
        InvalidOption: no preset has this name.
    """
    try:
        return _PRESETS[name.lower()]
    except KeyError:
        raise InvalidOption(f"no sensor preset {name!r}; there are {', '.join(presets())}") from None
