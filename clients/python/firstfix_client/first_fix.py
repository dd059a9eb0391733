"""The first fix of a running robot: the logic of the ROS 2 node and of the gateway."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import FirstfixError, NotFound
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros.header import Header
from firstfix.ros.imu import GravityWindow, decode_imu
from firstfix.ros.point_cloud2 import decode_point_cloud2
from firstfix.ros.pose_message import MAP_FRAME, to_pose_cdr
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix

Ask = Callable[[Scan, LocalizeOptions], Localization]
Lookup = Callable[[str, str], "Matrix | None"]  # (target, source) to T_target_source, None if unknown


class State(str, Enum):
    """State of the search for a fix."""

    IDLE = "idle"  # no fix is wanted, and there was none
    WAITING = "waiting"  # for a cloud
    ASKING = "asking"
    LOCALIZED = "localized"
    NOT_LOCALIZED = "not localized"  # the last cloud; the next one is tried
    FAILED = "failed"  # the last cloud was unusable, or no service answered; the next one is tried


@dataclass(frozen=True)
class Status:
    """State and result of the last try.

    Attributes:
        tries: clouds sent since ``want`` was called last.
        answer: the last answer, None before the first.
        error: why the last try failed, or empty.
        took_s: duration of the last try.
    """

    state: State = State.IDLE
    tries: int = 0
    answer: Localization | None = None
    error: str = ""
    took_s: float = 0.0


@dataclass(frozen=True)
class FirstFixConfig:
    """Configuration of the search for a fix.

    Attributes:
        options: sent with every query.
        map_frame: frame of the published pose.
        base_frame: the robot's base frame, whose pose is published; empty: the sensor's pose is published.
        retry_s: wait between two tries.
    """

    options: LocalizeOptions = field(default_factory=LocalizeOptions)
    map_frame: str = MAP_FRAME
    base_frame: str = ""
    retry_s: float = 1.0


class FirstFix:
    """Search for a fix: sends the newest cloud, in its own thread, until one is localized.

    Then it rests until ``want`` is called. Thread-safe. Close it, or use it in a ``with``. ``on_cloud`` and
    ``on_imu`` return at once.

    Args:
        ask: a client's ``localize`` for one map.
        publish: takes a PoseWithCovarianceStamped in CDR and the answer; called in the thread.
        lookup: transforms between fixed frames, as tf2 has them.
    """

    def __init__(
        self,
        ask: Ask,
        publish: Callable[[bytes, Localization], None],
        config: FirstFixConfig,
        lookup: Lookup = lambda target, source: None,
    ) -> None:
        self._ask = ask
        self._publish = publish
        self._config = config
        self._lookup = lookup
        self._window = GravityWindow()
        self._changed = threading.Condition()
        self._wanted = self._closed = False
        self._cloud: bytes | None = None
        self._status = Status()
        self._thread = threading.Thread(target=self._run, name="first fix", daemon=True)
        self._thread.start()

    def __enter__(self) -> FirstFix:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Waits for the current try, then ends the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    @property
    def status(self) -> Status:
        """State and result of the last try."""
        with self._changed:
            return self._status

    @property
    def wanted(self) -> bool:
        """True while a fix is wanted. Clouds are used only then."""
        with self._changed:
            return self._wanted

    def want(self) -> None:
        """Starts the search (again), with a cloud that comes after this call."""
        with self._changed:
            self._wanted, self._cloud = True, None
            self._status = Status(State.WAITING)

    def on_cloud(self, body: bytes) -> None:
        """Takes a cloud; the newest one is sent next. Ignored when no fix is wanted.

        Args:
            body: a PointCloud2 in CDR.
        """
        with self._changed:
            if self._wanted:
                self._cloud = body
                self._changed.notify()

    def on_imu(self, body: bytes) -> None:
        """Takes an IMU sample; at rest it shows which way is down.

        Args:
            body: an Imu in CDR.

        Raises:
            MalformedData, UnsupportedFormat: the bytes are not an Imu.
        """
        sample = decode_imu(body)
        with self._changed:
            self._window.add(sample)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._cloud is not None)
                if self._closed:
                    return
                cloud, self._cloud = self._cloud, None
                asking = self._status = replace(
                    self._status, state=State.ASKING, tries=self._status.tries + 1
                )
            assert cloud is not None
            begin = time.monotonic()
            status = replace(self._try(cloud, asking), took_s=time.monotonic() - begin)
            with self._changed:
                if self._status is asking:  # ``want`` was not called meanwhile
                    self._status = status
                    self._wanted = status.state is not State.LOCALIZED
                    if not self._wanted:
                        self._cloud = None  # came during the query
                self._changed.wait_for(lambda: self._closed, self._config.retry_s if self._wanted else 0)

    def _try(self, cloud: bytes, status: Status) -> Status:
        try:
            stamped = decode_point_cloud2(cloud, SCAN_LIMITS)
            answer = self._ask(stamped.scan(), self._options(stamped.header))
            if answer.T_map_sensor is None:
                return replace(status, state=State.NOT_LOCALIZED, answer=answer, error="")
            self._publish(to_pose_cdr(answer, stamped.header.stamp, self._config.map_frame), answer)
            return replace(status, state=State.LOCALIZED, answer=answer, error="")
        except (FirstfixError, ConnectionError) as error:
            return replace(status, state=State.FAILED, error=str(error))
        except Exception as error:  # a defect must not end the thread in silence
            return replace(status, state=State.FAILED, error=f"defect: {error!r}")

    def _options(self, header: Header) -> LocalizeOptions:
        options = self._config.options
        base = self._config.base_frame
        if base:
            mounting = self._lookup(base, header.frame_id)
            if mounting is None:  # the sensor's pose instead would be wrong
                raise NotFound(f"no transform between the frames {base!r} and {header.frame_id!r} yet")
            options = replace(options, T_base_sensor=mounting)
        gravity = self._gravity(header)
        return options if gravity is None else replace(options, gravity=gravity)

    def _gravity(self, header: Header) -> NDArray[np.float64] | None:
        with self._changed:
            down, frame = self._window.down(header.stamp), self._window.frame_id
        if down is None or frame == header.frame_id:
            return down
        T_sensor_imu = self._lookup(header.frame_id, frame)
        return None if T_sensor_imu is None else T_sensor_imu[:3, :3] @ down
