"""Presets of common LiDARs, after their vendors' manuals: what each one's ``SensorModel`` is made of."""

from __future__ import annotations

from typing import Any

from .beams import HDL_64E, PANDAR64, QT64, QT128, even


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
_SPINNING = {
    "vlp-16": _spinning(even(-15, 15, 16), 0.2, (0.5, 100), 0.6),
    "hdl-32e": _spinning(even(-30.67, 10.67, 32), 0.2, (1.0, 100), 1.0),
    "hdl-64e": _spinning(HDL_64E, 0.2, (1.5, 120), 1.73),
    # 1024 columns. Ouster's beams are evenly spaced to within 0.3 degrees.
    "os0-32": _spinning(even(-45, 45, 32), 360 / 1024, (0.3, 50), 1.0),
    "os0-64": _spinning(even(-45, 45, 64), 360 / 1024, (0.3, 50), 1.0),
    "os0-128": _spinning(even(-45, 45, 128), 360 / 1024, (0.3, 50), 1.0),
    "os1-32": _spinning(even(-22.5, 22.5, 32), 360 / 1024, (0.3, 120), 1.0),
    "os1-64": _spinning(even(-22.5, 22.5, 64), 360 / 1024, (0.3, 120), 1.0),
    "os1-128": _spinning(even(-22.5, 22.5, 128), 360 / 1024, (0.3, 120), 1.0),
    "xt16": _spinning(even(-15, 15, 16), 0.18, (0.3, 120), 0.8),
    "xt32": _spinning(even(-16, 15, 32), 0.18, (0.3, 120), 0.8),
    "qt64": _spinning(QT64, 0.6, (0.1, 60), 0.8),
    "qt128": _spinning(QT128, 0.4, (0.05, 50), 0.8),
    "pandar64": _spinning(PANDAR64, 0.2, (0.3, 200), 1.73),
}
PRESETS: dict[str, dict[str, Any]] = {
    **_SPINNING,
    # 20,000 points in 0.1 s; as rows for templates, 40 of 500 columns.
    "mid-360": {**_spinning(even(-7, 52, 40), 0.72, (0.1, 70), 0.5), "pattern": "rosette"},
}
