"""sensor_msgs/Imu, of which the direction of gravity is wanted."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cdr import MessageReader
from .header import Header, Stamp, read_header

TYPE = "sensor_msgs/msg/Imu"
WINDOW_S = 0.5
_UNITS = (9.80665, 1.0)  # m/s2 as REP-145 asks; some drivers (Livox) publish in g
_AT_REST = 0.1  # the mean may differ from gravity by this share: more, and the robot accelerates


@dataclass(frozen=True)
class ImuSample:
    """
    Attributes:
        acceleration: (3,) specific force in the IMU's frame: at rest it points up.
    """

    header: Header
    acceleration: NDArray[np.float64]


def decode_imu(body: bytes | memoryview, *, ros1: bool = False) -> ImuSample:
    """
    Raises:
        MalformedData: not an Imu's bytes.
        UnsupportedFormat: no plain CDR.
    """
    reader = MessageReader("Imu", body, ros1=ros1)
    header = read_header(reader)
    reader.floats(4 + 9)  # orientation: many drivers fill it with what is no orientation
    reader.floats(3 + 9)
    acceleration = np.array(reader.floats(3))
    reader.floats(9)
    reader.end()
    return ImuSample(header, acceleration)


class GravityWindow:
    """The IMU's last half second. One instance for one IMU."""

    def __init__(self) -> None:
        self._samples: deque[ImuSample] = deque()

    @property
    def frame_id(self) -> str:
        """Of the last sample; empty before there is one."""
        return self._samples[-1].header.frame_id if self._samples else ""

    def add(self, sample: ImuSample) -> None:
        if self._samples and sample.header.stamp < self._samples[-1].header.stamp:
            self._samples.clear()  # the clock was set back, or a bag begins again
        self._samples.append(sample)
        self._forget_before(sample.header.stamp)

    def down(self, at: Stamp) -> NDArray[np.float64] | None:
        """(3,) unit direction of gravity in the IMU's frame, or None: no recent samples, or it moves."""
        near = [s for s in self._samples if abs(s.header.stamp.ns - at.ns) <= WINDOW_S * 1e9]
        return down_of(sample.acceleration for sample in near)

    def _forget_before(self, newest: Stamp) -> None:
        # twice the window: a scan may arrive later than the samples of its time
        while newest.ns - self._samples[0].header.stamp.ns > 2 * WINDOW_S * 1e9:
            self._samples.popleft()


def down_of(accelerations: Iterable[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """(3,) unit direction of gravity, or None where the mean is not that of an IMU at rest."""
    values = np.array(list(accelerations))
    if not len(values) or not np.isfinite(values).all():
        return None
    mean: NDArray[np.float64] = values.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if not any(abs(size - unit) <= _AT_REST * unit for unit in _UNITS):
        return None
    return -mean / size
