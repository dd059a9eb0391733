"""The direction of gravity from sensor_msgs/Imu."""

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
_MAX_SAMPLES = 4000  # an IMU without a clock gives all its samples one stamp
_UNITS = (9.80665, 1.0)  # m/s2 as in REP-145; some drivers (Livox) publish in g
_AT_REST = 0.1  # relative difference between the mean and gravity; beyond it, the robot accelerates


@dataclass(frozen=True)
class ImuSample:
    """One measurement of an IMU.

    Attributes:
        acceleration: (3,) specific force in the IMU's frame. At rest it points up.
    """

    header: Header
    acceleration: NDArray[np.float64]


def decode_imu(body: bytes | memoryview, *, ros1: bool = False) -> ImuSample:
    """Decode an Imu message.

    Raises:
        MalformedData: not an Imu message.
        UnsupportedFormat: not plain CDR.
    """
    reader = MessageReader("Imu", body, ros1=ros1)
    header = read_header(reader)
    reader.floats(4 + 9)  # the orientation, which many drivers do not fill correctly
    reader.floats(3 + 9)
    acceleration = np.array(reader.floats(3))
    reader.floats(9)
    reader.end()
    return ImuSample(header, acceleration)


class GravityWindow:
    """Measurements of one IMU in the last half second."""

    def __init__(self) -> None:
        self._samples: deque[ImuSample] = deque(maxlen=_MAX_SAMPLES)
        self._newest_ns = 0

    @property
    def frame_id(self) -> str:
        """Frame of the last sample; empty if there is none."""
        return self._samples[-1].header.frame_id if self._samples else ""

    def add(self, sample: ImuSample) -> None:
        """Add a sample and forgets old ones."""
        ns = sample.header.stamp.ns
        if self._newest_ns - ns > WINDOW_S * 1e9:  # more than a sample that came late
            self._samples.clear()  # the clock was set back, or a bag was restarted
            self._newest_ns = 0
        self._newest_ns = max(self._newest_ns, ns)
        self._samples.append(sample)
        # Twice the window: a scan may arrive after the samples of its time.
        while self._newest_ns - self._samples[0].header.stamp.ns > 2 * WINDOW_S * 1e9:
            self._samples.popleft()

    def down(self, at: Stamp) -> NDArray[np.float64] | None:
        """The (3,) unit direction of gravity in the IMU's frame.

        None if there are no samples near this time, or if the IMU accelerates.
        """
        near = [s for s in self._samples if abs(s.header.stamp.ns - at.ns) <= WINDOW_S * 1e9]
        return down_of(sample.acceleration for sample in near)


def down_of(accelerations: Iterable[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """The (3,) unit direction of gravity. None if the mean is not that of an IMU at rest."""
    values = np.array(list(accelerations))
    if not len(values) or not np.isfinite(values).all():
        return None
    mean: NDArray[np.float64] = values.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if not any(abs(size - unit) <= _AT_REST * unit for unit in _UNITS):
        return None
    return -mean / size
