"""Options of a query, with the same names over HTTP, zenoh and in Python."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import transform
from ..errors import InvalidOption
from ..scan.scan import Dropped
from .prior import Prior

MAX_CANDIDATES = 100
MAX_LINEAR_M_S, MAX_ANGULAR_RAD_S = 100.0, 20.0  # of a twist, along each axis: as in the compiled core
MAX_NUMBER = 1e9  # metres or degrees; more means nothing, and squares above 1e154 are infinite


@dataclass(frozen=True)
class LocalizeOptions:
    """Options of one query.

    Attributes:
        gravity: (3,) direction of gravity in the sensor frame, pointing down: the negated acceleration of a
            resting IMU. None: it is estimated from the scan, in any orientation of the sensor.
        prior: region in which the robot is known to be; None: anywhere in the map.
        T_base_sensor: (4, 4) mounting of the sensor. If given, the answer also has T_map_base, and up is
            searched near the robot's z first.
        max_candidates: largest number of candidates to register; None: the map's own default.
        min_probability: below it the answer is not ``localized``; None: the map's own default.
        max_false_accept: in place of ``min_probability``: the threshold is the lowest that, with 95 %
            confidence, accepts at most this share of scans whose place is not in the map or not found.
        deadline_ms: time after which the caller no longer needs the answer; None: no deadline. A further
            search for a hard scan that would end later does not begin.
        version: digest of the map version to use, or its first characters; None: the active version.
        twist: (6,) motion of the sensor during the scan, which the caller knows from elsewhere: m/s then
            rad/s, in the sensor frame at the scan's stamp. The scan is deskewed by it, so the times of its
            points must be known. None: the motion is solved with the pose, where the times are known.
        dropped: points that the caller left out of the scan; the findings name what is wrong with them.
        T_odom_base: (4, 4) pose of the robot's base at the scan's stamp in its odometry's frame; without
            ``T_base_sensor``, of the sensor. It changes no answer. A recorded query has it, so that the
            robot's motion between two fixes can confirm both.
    """

    gravity: NDArray[np.float64] | None = None
    prior: Prior | None = None
    T_base_sensor: NDArray[np.float64] | None = None
    max_candidates: int | None = None
    min_probability: float | None = None
    max_false_accept: float | None = None
    deadline_ms: float | None = None
    version: str | None = None
    twist: NDArray[np.float64] | None = None
    dropped: Dropped | None = None
    T_odom_base: NDArray[np.float64] | None = None

    def deadline_from(self, start_s: float) -> float:
        """Deadline on ``time.monotonic`` of a query that came at ``start_s``; inf: none."""
        return math.inf if self.deadline_ms is None else start_s + self.deadline_ms / 1e3

    @classmethod
    def from_strings(cls, values: Mapping[str, str], beside: Iterable[str] = ()) -> LocalizeOptions:
        """Options from query parameters.

        Forms: ``gravity=x,y,z`` or ``gravity=roll_deg,pitch_deg``; ``prior=x,y,z,radius_m`` or
        ``prior=x,y,z,radius_m,yaw_deg,yaw_range_deg``; ``T_base_sensor=x,y,z,qx,qy,qz,qw``, and
        ``T_odom_base`` alike; ``twist=vx,vy,vz,wx,wy,wz``; ``dropped=not_finite,too_far,far_m,spread_m``; the
        others are plain numbers or text.

        Args:
            beside: other parameters that a query may have: a misspelt name may mean one of them.

        Raises:
            InvalidOption: an unknown name, or a value with a wrong form or out of range.
        """
        unknown = sorted(set(values) - set(cls.__dataclass_fields__))
        if unknown:
            near = _nearest(unknown[0], (*cls.__dataclass_fields__, *beside))
            raise InvalidOption(
                f"no option {', '.join(unknown)[:200]}" + (f": did you mean {near}?" if near else "")
            )
        options: dict[str, Any] = {}
        if "gravity" in values:
            options["gravity"] = _gravity(_numbers("gravity", values["gravity"], (2, 3)))
        if "prior" in values:
            options["prior"] = Prior.from_numbers(_numbers("prior", values["prior"], (4, 6)))
        for name in ("T_base_sensor", "T_odom_base"):
            if name in values:
                options[name] = _pose(name, values[name])
        if "max_candidates" in values:
            options["max_candidates"] = int(_number("max_candidates", values, 1, MAX_CANDIDATES))
        if "min_probability" in values:
            options["min_probability"] = _number("min_probability", values, 0, 1)
        if "max_false_accept" in values:
            if "min_probability" in values:
                raise InvalidOption("min_probability and max_false_accept both set the threshold: give one")
            options["max_false_accept"] = _number("max_false_accept", values, 0, 1)
        if "deadline_ms" in values:
            options["deadline_ms"] = _number("deadline_ms", values, 1, 600_000)
        if "version" in values:
            options["version"] = values["version"]
        if "twist" in values:
            options["twist"] = _twist(_numbers("twist", values["twist"], (6,)))
        if "dropped" in values:
            not_finite, too_far, far_m, spread_m = _numbers("dropped", values["dropped"], (4,))
            if min(not_finite, too_far, far_m, spread_m) < 0:
                raise InvalidOption("dropped: no number is below 0")
            options["dropped"] = Dropped(int(not_finite), int(too_far), far_m, spread_m)
        return cls(**options)

    def to_strings(self) -> dict[str, str]:
        """Query parameters that ``from_strings`` reads, as clients send them."""
        values: dict[str, str] = {}
        if self.gravity is not None:
            values["gravity"] = _joined(self.gravity)
        if self.prior is not None:
            values["prior"] = _joined(self.prior.to_numbers())
        for name in ("T_base_sensor", "T_odom_base"):
            T = getattr(self, name)
            if T is not None:
                values[name] = _joined([*T[:3, 3], *transform.quaternion_of(T)])
        for name in ("max_candidates", "min_probability", "max_false_accept", "deadline_ms", "version"):
            value = getattr(self, name)
            if value is not None:
                values[name] = value if isinstance(value, str) else json.dumps(value)
        if self.twist is not None:
            values["twist"] = _joined(self.twist)
        if self.dropped is not None:
            values["dropped"] = _joined(astuple(self.dropped))
        return values


def _nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name that one most resembles; the longest with which it begins, as map of map_id."""
    plain = {one.lower(): one for one in known}
    near = get_close_matches(name[:40].lower(), plain, 1, cutoff=0.7)
    begun = sorted((one for one in plain if name.lower().startswith(one)), key=len)
    return plain[(near or begun)[-1]] if near or begun else None


def _numbers(name: str, text: str, counts: tuple[int, ...]) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(abs(v) <= MAX_NUMBER for v in numbers):  # NaN neither
        wanted = " or ".join(str(count) for count in counts)
        raise InvalidOption(f"{name} is {wanted} numbers separated by commas, not {text[:80]!r}")
    return numbers


def _joined(numbers: Iterable[float]) -> str:
    return ",".join(repr(float(v)) for v in numbers)


def _number(name: str, values: Mapping[str, str], low: float, high: float) -> float:
    value = _numbers(name, values[name], (1,))[0]
    if not low <= value <= high:
        raise InvalidOption(f"{name} must lie in [{low}, {high}], not {value}")
    return value


def _pose(name: str, text: str) -> NDArray[np.float64]:
    seven = _numbers(name, text, (7,))
    try:
        return transform.from_quaternion(seven[:3], seven[3:])
    except ValueError as error:
        raise InvalidOption(f"{name}: {error}") from None


def _gravity(numbers: list[float]) -> NDArray[np.float64]:
    if len(numbers) == 2:  # roll about x, then pitch about y, of the sensor in a level frame
        roll, pitch = np.radians(numbers)
        return np.array([np.sin(pitch), -np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll)])
    x, y, z = numbers
    length = math.sqrt(x * x + y * y + z * z)  # in an order of its own: the same bits on every robot
    if length < 1e-6:
        raise InvalidOption("gravity has no direction")
    return np.array([x, y, z]) / length


def _twist(numbers: list[float]) -> NDArray[np.float64]:
    twist = np.asarray(numbers, np.float64)
    if not (np.abs(twist) <= np.repeat([MAX_LINEAR_M_S, MAX_ANGULAR_RAD_S], 3)).all():
        limits = f"{MAX_LINEAR_M_S:g} m/s and {MAX_ANGULAR_RAD_S:g} rad/s"
        raise InvalidOption(f"twist: at most {limits} along each axis")
    return twist
