"""A query for one cloud of a robot, and the fix that its answer gives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.errors import NotFound
from firstfix.ros.header import Header, Stamp
from firstfix.ros.point_cloud2 import StampedCloud
from firstfix.ros.pose_message import covariance_of_base
from firstfix.transform import Matrix

from .answerer import Answerer
from .config import GatewayConfig
from .senses import Senses


@dataclass(frozen=True)
class Fix:
    """A localized answer.

    Attributes:
        frame: the robot's base frame if it is configured, else the cloud's.
        stamp: the cloud's.
        T_map_frame: (4, 4) pose of the frame.
        covariance: (6, 6) of this pose.
        T_odom_frame: (4, 4) pose of the frame by odometry at the stamp; None if not known.
    """

    frame: str
    stamp: Stamp
    T_map_frame: Matrix
    covariance: NDArray[np.float64]
    T_odom_frame: Matrix | None


class Query:
    """One cloud with its mounting and gravity, ready to be asked for.

    Raises:
        NotFound: the mounting of the sensor on the base is needed, and not known yet.
        InvalidScan, TooLarge: see ``StampedCloud.scan``.
    """

    def __init__(self, cloud: StampedCloud, senses: Senses, config: GatewayConfig) -> None:
        self.header: Header = cloud.header
        self.frame = config.base_frame or cloud.header.frame_id
        self._senses = senses
        self._scan = cloud.scan()
        options = config.options
        if config.base_frame:
            mounting = senses.between(config.base_frame, self.header.frame_id, self.header.stamp)
            if mounting is None:  # the sensor's pose instead would be wrong
                frames = f"{config.base_frame!r} and {self.header.frame_id!r}"
                raise NotFound(f"no transform between the frames {frames} yet")
            options = replace(options, T_base_sensor=mounting)
        gravity = senses.gravity(self.header)
        T_odom_base = senses.odometry(self.frame, self.header.stamp)  # None: of a cloud that was quicker
        self._options = replace(
            options, gravity=options.gravity if gravity is None else gravity, T_odom_base=T_odom_base
        )

    @property
    def T_frame_sensor(self) -> Matrix | None:
        """Mounting of the sensor on the frame; None if the frame is the sensor's own."""
        return self._options.T_base_sensor

    @property
    def has_odometry(self) -> bool:
        """Whether the service is told the robot's odometry."""
        return self._options.T_odom_base is not None

    def ask(self, answerer: Answerer, prior: Prior | None = None) -> Localization:
        """Asks, with a prior or with the configured options alone.

        Raises:
            FirstfixError, ConnectionError: no answer.
        """
        options: LocalizeOptions = self._options
        return answerer(self._scan, options if prior is None else replace(options, prior=prior))

    def fix(self, answer: Localization) -> Fix | None:
        """The fix of an answer; None if it is not localized."""
        if answer.T_map_sensor is None or answer.covariance is None:
            return None
        T, covariance = answer.T_map_sensor, answer.covariance
        if answer.T_map_base is not None:
            T, covariance = answer.T_map_base, covariance_of_base(T, answer.T_map_base, covariance)
        T_odom_frame = self._senses.odometry(self.frame, self.header.stamp)
        return Fix(self.frame, self.header.stamp, T, covariance, T_odom_frame)
