"""Presets of common LiDARs, after their vendors' manuals: what each one's ``SensorModel`` is made of.

docs/reference/sensors.md has the source of each number, and says which ones nobody has checked.
"""

from __future__ import annotations

from typing import Any

from .beams import (
    HDL_64E,
    HELIOS_1610,
    HELIOS_5515,
    JT16,
    JT128,
    PANDAR64,
    QT64,
    QT128,
    VLP_32C,
    VLS_128,
    even,
)


def _spinning(
    elevations_deg: tuple[float, ...],
    azimuth_step_deg: float,
    range_m: tuple[float, float],
    mount_height_m: float,
) -> dict[str, Any]:
    return {
        "elevations_deg": elevations_deg,
        "azimuth_step_deg": azimuth_step_deg,
        "min_range_m": range_m[0],
        "max_range_m": range_m[1],
        "mount_height_m": mount_height_m,
    }


# At 10 turns a second, on a robot that often has the sensor (HDL-64E, Pandar64: on a car).
_SPINNING: dict[str, dict[str, Any]] = {
    "vlp-16": _spinning(even(-15, 15, 16), 0.2, (0.5, 100), 0.6),
    "puck-hi-res": _spinning(even(-10, 10, 16), 0.2, (0.5, 100), 0.6),
    "vlp-32c": _spinning(VLP_32C, 0.2, (0.4, 200), 1.0),
    "hdl-32e": _spinning(even(-30.67, 10.67, 32), 0.2, (1.0, 100), 1.0),
    "hdl-64e": _spinning(HDL_64E, 0.2, (1.5, 120), 1.73),
    "vls-128": _spinning(VLS_128, 0.2, (0.4, 200), 1.73),
    # 1024 columns. Ouster's beams are evenly spaced to within 0.3 degrees.
    "os0-32": _spinning(even(-45, 45, 32), 360 / 1024, (0.3, 50), 1.0),
    "os0-64": _spinning(even(-45, 45, 64), 360 / 1024, (0.3, 50), 1.0),
    "os0-128": _spinning(even(-45, 45, 128), 360 / 1024, (0.3, 50), 1.0),
    "os1-32": _spinning(even(-22.5, 22.5, 32), 360 / 1024, (0.3, 120), 1.0),
    "os1-64": _spinning(even(-22.5, 22.5, 64), 360 / 1024, (0.3, 120), 1.0),
    "os1-128": _spinning(even(-22.5, 22.5, 128), 360 / 1024, (0.3, 120), 1.0),
    "os2-32": _spinning(even(-11.25, 11.25, 32), 360 / 1024, (1.0, 240), 1.73),
    "os2-64": _spinning(even(-11.25, 11.25, 64), 360 / 1024, (1.0, 240), 1.73),
    "os2-128": _spinning(even(-11.25, 11.25, 128), 360 / 1024, (1.0, 240), 1.73),
    "osdome-32": _spinning(even(0, 87.2, 32), 360 / 1024, (0.5, 45), 1.0),
    "osdome-64": _spinning(even(0, 88.6, 64), 360 / 1024, (0.5, 45), 1.0),
    "osdome-128": _spinning(even(0, 89.3, 128), 360 / 1024, (0.5, 45), 1.0),
    "xt16": _spinning(even(-15, 15, 16), 0.18, (0.3, 120), 0.8),
    "xt32": _spinning(even(-16, 15, 32), 0.18, (0.3, 120), 0.8),
    "qt64": _spinning(QT64, 0.6, (0.1, 60), 0.8),
    "qt128": _spinning(QT128, 0.4, (0.05, 50), 0.8),
    "jt16": _spinning(JT16, 0.6, (0.1, 30), 0.4),
    "jt128": _spinning(JT128, 0.4, (0.1, 30), 0.4),
    "pandar64": _spinning(PANDAR64, 0.2, (0.3, 200), 1.73),
    "rs-helios-16p": _spinning(even(-15, 15, 16), 0.2, (0.2, 110), 0.8),
    "rs-helios-1610": _spinning(HELIOS_1610, 0.2, (0.2, 110), 0.8),
    "rs-helios-1615": _spinning(even(-16, 15, 32), 0.2, (0.2, 110), 0.8),
    "rs-helios-5515": _spinning(HELIOS_5515, 0.2, (0.2, 110), 0.8),
    "rs-airy": _spinning(even(0, 89.5, 96), 0.4, (0.1, 60), 0.4),
}
# Flashes, and scanners of no rows. The rosette has the rays of 0.1 s; as rows for templates.
_OTHER: dict[str, dict[str, Any]] = {
    "rs-e1r": {
        **_spinning(even(-45, 45, 144), 0.625, (0.1, 30), 0.5),
        "azimuth_fov_deg": 120.0,
        "range_noise_m": 0.05,
    },
    "mid-360": {**_spinning(even(-7, 52, 40), 0.72, (0.1, 70), 0.5), "pattern": "rosette"},  # 20,000 rays
    "mid-70": {  # 10,000 rays; its field is a circle
        **_spinning(even(-35.2, 35.2, 40), 70.4 / 250, (0.05, 130), 0.5),
        "pattern": "rosette",
        "azimuth_fov_deg": 70.4,
    },
    "avia": {  # 24,000 rays
        **_spinning(even(-38.6, 38.6, 40), 70.4 / 600, (0.1, 200), 1.0),
        "pattern": "rosette",
        "azimuth_fov_deg": 70.4,
    },
    "hap": {  # 45,200 rays
        **_spinning(even(-12.5, 12.5, 40), 120 / 1130, (0.5, 150), 1.0),
        "pattern": "rosette",
        "azimuth_fov_deg": 120.0,
    },
    # Meridians that turn. Of their scans the rosette has the number of rays and the field of view.
    "unitree-l1": {**_spinning(even(0, 89, 30), 5.0, (0.05, 30), 0.4), "pattern": "rosette"},  # 2,160 rays
    "unitree-l2": {**_spinning(even(0, 89, 32), 1.8, (0.05, 30), 0.4), "pattern": "rosette"},  # 6,400 rays
}
PRESETS: dict[str, dict[str, Any]] = {**_SPINNING, **_OTHER}
