"""Georeference of a map, and geographic poses (OGC GeoPose) of what is localized in it.

The computation is exact on the WGS84 ellipsoid, through Earth-centred, Earth-fixed coordinates (ECEF),
without a map projection. Frames: ``ecef``; ``enu``, the local tangent frame at a point, x east, y north, z up
along the ellipsoid's normal; ``map``; ``body``, the sensor's or the robot's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidOption
from ..transform import Matrix, from_quaternion, inverse, make_transform, quaternion_of, rotation_z

MEDIA_TYPE = "application/geopose+json"
SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
_E2 = FLATTENING * (2 - FLATTENING)  # first eccentricity squared
_ROUNDS = 10  # of the fixed-point iteration for the latitude: each adds over two digits near the Earth
MAX_HEIGHT_M = 100_000.0
MAX_ANCHOR_M = 1e8  # projected coordinates, such as UTM's, have seven digits before the point


@dataclass(frozen=True)
class Georeference:
    """Geographic position of one point of a map, the anchor, and the map's orientation there.

    Attributes:
        latitude_deg, longitude_deg: of the anchor, WGS84.
        height_m: of the anchor above the WGS84 ellipsoid, not above sea level.
        quaternion: (x, y, z, w) of R_enu_map: the map's axes in the east-north-up frame at the anchor.
        anchor_m: (3,) the anchor in map coordinates. By default the map's origin. For a map in projected
            coordinates (UTM) choose a point in its middle, because such a frame is accurate only nearby.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float
    quaternion: tuple[float, float, float, float]
    anchor_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidOption: a value is out of range, or the quaternion is not a rotation.
        """
        values = (self.latitude_deg, self.longitude_deg, self.height_m, *self.quaternion, *self.anchor_m)
        if len(self.quaternion) != 4 or len(self.anchor_m) != 3 or not all(map(math.isfinite, values)):
            raise InvalidOption(
                "a georeference needs finite numbers, four for the quaternion and three for the anchor"
            )
        if abs(self.latitude_deg) > 90 or abs(self.longitude_deg) > 180:
            raise InvalidOption("a latitude is within 90 degrees, a longitude within 180")
        if abs(self.height_m) > MAX_HEIGHT_M or max(map(abs, self.anchor_m)) > MAX_ANCHOR_M:
            raise InvalidOption(f"a height is within {MAX_HEIGHT_M:g} m, an anchor within {MAX_ANCHOR_M:g} m")
        if abs(math.hypot(*self.quaternion) - 1) > 1e-3:
            raise InvalidOption("the quaternion must have length 1")

    @classmethod
    def with_heading(
        cls,
        latitude_deg: float,
        longitude_deg: float,
        height_m: float,
        x_axis_deg: float,
        anchor_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Georeference:
        """Georeference of a map whose z axis points up.

        Args:
            x_axis_deg: direction of the map's x axis, counter-clockwise from east seen from above (REP-103):
                0 is east, 90 is north. For a compass heading h it is ``90 - h``.
        """
        half = math.radians(x_axis_deg) / 2
        turn = (0.0, 0.0, math.sin(half), math.cos(half))
        return cls(latitude_deg, longitude_deg, height_m, turn, anchor_m)

    @property
    def x_axis_deg(self) -> float:
        """Direction of the map's x axis in degrees, counter-clockwise from east."""
        x = self._R_enu_map[:, 0]
        return math.degrees(math.atan2(x[1], x[0]))

    @property
    def _R_enu_map(self) -> NDArray[np.float64]:
        return from_quaternion((0, 0, 0), self.quaternion)[:3, :3]

    @property
    def T_ecef_map(self) -> Matrix:
        """(4, 4) transform from map coordinates to ECEF, metres."""
        T_ecef_anchor = T_ecef_enu(self.latitude_deg, self.longitude_deg, self.height_m)
        R_ecef_map = T_ecef_anchor[:3, :3] @ self._R_enu_map
        return make_transform(R_ecef_map, T_ecef_anchor[:3, 3] - R_ecef_map @ np.asarray(self.anchor_m))

    def geopose(self, T_map_body: Matrix) -> dict[str, Any]:
        """Geographic pose in the form of OGC GeoPose 1.0, Basic-Quaternion.

        The quaternion gives the body's axes in the east-north-up frame at the body's own position.
        """
        T_ecef_body = self.T_ecef_map @ T_map_body
        latitude_deg, longitude_deg, height_m = geodetic_of(T_ecef_body[:3, 3])
        R_enu_ecef = inverse(T_ecef_enu(latitude_deg, longitude_deg, height_m))[:3, :3]
        x, y, z, w = quaternion_of(make_transform(R_enu_ecef @ T_ecef_body[:3, :3], (0, 0, 0)))
        return {
            "position": {"lat": latitude_deg, "lon": longitude_deg, "h": height_m},
            "quaternion": {"x": float(x), "y": float(y), "z": float(z), "w": float(w)},
        }

    def to_mapping(self) -> dict[str, Any]:
        """JSON-ready form."""
        return {
            "latitude_deg": self.latitude_deg,
            "longitude_deg": self.longitude_deg,
            "height_m": self.height_m,
            "quaternion": list(self.quaternion),
            "anchor_m": list(self.anchor_m),
        }

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Georeference:
        """Parse the result of ``to_mapping``.

        Raises:
            InvalidOption: the data is malformed.
        """
        try:
            x, y, z, w = (float(v) for v in data["quaternion"])
            ax, ay, az = (float(v) for v in data["anchor_m"])
            lat, lon, h = (float(data[name]) for name in ("latitude_deg", "longitude_deg", "height_m"))
            return cls(lat, lon, h, (x, y, z, w), (ax, ay, az))
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidOption(f"not a georeference: {error!r}") from None


def ecef_of(latitude_deg: float, longitude_deg: float, height_m: float) -> NDArray[np.float64]:
    """ECEF position, (3,) metres, from WGS84 degrees and metres above the ellipsoid."""
    phi, lam = math.radians(latitude_deg), math.radians(longitude_deg)
    normal_m = SEMI_MAJOR_M / math.sqrt(1 - _E2 * math.sin(phi) ** 2)
    across_m = (normal_m + height_m) * math.cos(phi)
    up_m = (normal_m * (1 - _E2) + height_m) * math.sin(phi)
    return np.array([across_m * math.cos(lam), across_m * math.sin(lam), up_m])


def geodetic_of(ecef_m: ArrayLike) -> tuple[float, float, float]:
    """Latitude and longitude in degrees, and height in metres, of an ECEF position.

    Bowring's iteration over the reduced latitude, accurate to the last bits of float64 within 100 km of the
    ellipsoid.
    """
    x, y, z = (float(v) for v in np.asarray(ecef_m, np.float64))
    semi_minor_m = SEMI_MAJOR_M * (1 - FLATTENING)
    across_m = math.hypot(x, y)
    second_e2 = _E2 / (1 - _E2)
    beta = math.atan2(z, across_m * (1 - FLATTENING))
    phi = 0.0
    for _ in range(_ROUNDS):
        phi = math.atan2(
            z + second_e2 * semi_minor_m * math.sin(beta) ** 3,
            across_m - _E2 * SEMI_MAJOR_M * math.cos(beta) ** 3,
        )
        beta = math.atan2((1 - FLATTENING) * math.sin(phi), math.cos(phi))
    # distance to the foot of the normal: stable at the poles and at the equator
    foot = (SEMI_MAJOR_M * math.cos(beta), semi_minor_m * math.sin(beta))
    height_m = (across_m - foot[0]) * math.cos(phi) + (z - foot[1]) * math.sin(phi)
    return math.degrees(phi), math.degrees(math.atan2(y, x)), height_m


def T_ecef_enu(latitude_deg: float, longitude_deg: float, height_m: float) -> Matrix:
    """(4, 4) transform from the east-north-up frame at a point to ECEF."""
    phi, lam = math.radians(latitude_deg), math.radians(longitude_deg)
    # at longitude and latitude 0, east is y and up is x: tilt around east, then rotate around z
    tilt = np.array(
        [
            [0.0, -math.sin(phi), math.cos(phi)],
            [1.0, 0.0, 0.0],
            [0.0, math.cos(phi), math.sin(phi)],
        ]
    )
    return make_transform(rotation_z(lam) @ tilt, ecef_of(latitude_deg, longitude_deg, height_m))
