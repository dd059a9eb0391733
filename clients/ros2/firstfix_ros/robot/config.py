"""Configuration of a robot's gateway."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import MAX_RADIUS_M
from firstfix.errors import InvalidOption
from firstfix.ros.header import check_frame
from firstfix.ros.pose_message import MAP_FRAME


@dataclass(frozen=True)
class GatewayConfig:
    """Frames and policies of a robot's gateway.

    Attributes:
        options: sent with every query.
        map_frame: frame of the published poses.
        odom_frame: frame of the odometry; ``publishes_tf`` gives ``map_frame`` -> ``odom_frame``.
        base_frame: the robot's base frame, whose pose is published; empty: the sensor's pose is published.
        at_start: search for a fix as soon as the gateway runs.
        retry_s: wait between two tries of a search.
        watch_s: time between two checks of the robot's own localization; 0: it is not watched.
        astray_m: distance from the robot's own pose to a fix, beyond which the robot has gone astray.
        astray_deg: the same for the angle.
        prior_radius_m: radius about the robot's own pose in which a check searches first.
        publishes_tf: publish ``map_frame`` -> ``odom_frame`` after a fix, unless somebody else does.
        repeat_s: a pose that the robot's localizer does not follow is published again, at most so often; 0:
            it is published once.
        young_s: so long a pose is repeated if the robot has no odometry, or if its localizer is not heard.
        memory: folder in which the last fix of each robot outlives the gateway; None: it does not.
    """

    options: LocalizeOptions = field(default_factory=LocalizeOptions)
    map_frame: str = MAP_FRAME
    odom_frame: str = "odom"
    base_frame: str = ""
    at_start: bool = True
    retry_s: float = 1.0
    watch_s: float = 0.0
    astray_m: float = 1.0
    astray_deg: float = 30.0
    prior_radius_m: float = 10.0
    publishes_tf: bool = True
    repeat_s: float = 5.0
    young_s: float = 10.0
    memory: Path | None = None

    def __post_init__(self) -> None:
        check_frame(self.map_frame)
        check_frame(self.odom_frame)
        if self.base_frame:
            check_frame(self.base_frame)
        if not (0 <= self.retry_s < 1e6 and 0 <= self.watch_s < 1e6):
            raise InvalidOption("the times between tries and between checks must be 0 or more seconds")
        if not (0 <= self.repeat_s < 1e6 and 0 <= self.young_s < 1e6):
            raise InvalidOption("the times of a pose that is published again must be 0 or more seconds")
        if not (0 < self.astray_m < 1e6 and 0 < self.astray_deg <= 180):
            raise InvalidOption("the limits of a robot astray must be more than 0 m, and at most 180 degrees")
        if not self.astray_m < self.prior_radius_m <= MAX_RADIUS_M:
            raise InvalidOption("the radius of the prior must be larger than the distance of a robot astray")
