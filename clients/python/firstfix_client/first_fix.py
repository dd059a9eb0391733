"""A running robot's clouds until one is localized: the logic of the ROS 2 node and of the gateway."""

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
Lookup = Callable[[str, str], "Matrix | None"]  # (target, source) to T_target_source, if it is known


class State(str, Enum):
    IDLE = "idle"  # no fix is wanted, and there was none
    WAITING = "waiting"  # for a cloud
    ASKING = "asking"
    LOCALIZED = "localized"
    NOT_LOCALIZED = "not localized"  # the last cloud was not; the next one is tried
    FAILED = "failed"  # the last cloud could not be used, or nobody answered; the next one is tried


@dataclass(frozen=True)
class Status:
    """What there is to tell.

    Attributes:
        tries: clouds asked for since a fix was wanted last.
        answer: the last one, None before it.
        error: why the last try failed, or empty.
        took_s: of the last try.
    """

    state: State = State.IDLE
    tries: int = 0
    answer: Localization | None = None
    error: str = ""
    took_s: float = 0.0


@dataclass(frozen=True)
class Wishes:
    """
    Attributes:
        options: of every query.
        map_frame: of the pose that is published.
        base_frame: the robot's, whose pose is published; empty: the sensor's is.
        retry_s: from one try to the next.
    """

    options: LocalizeOptions = field(default_factory=LocalizeOptions)
    map_frame: str = MAP_FRAME
    base_frame: str = ""
    retry_s: float = 1.0


class FirstFix:
    """Asks with the newest cloud, in a thread of its own, until it is localized; then rests until ``want``.

    Thread-safe; close it, or use it in a ``with``. ``on_cloud`` and ``on_imu`` return at once.

    Args:
        ask: a client's ``localize`` for one map.
        publish: takes a PoseWithCovarianceStamped in CDR and the answer; called in the thread.
        lookup: of fixed frames, as tf2 knows them.
    """

    def __init__(
        self,
        ask: Ask,
        publish: Callable[[bytes, Localization], None],
        wishes: Wishes,
        lookup: Lookup = lambda target, source: None,
    ) -> None:
        self._ask = ask
        self._publish = publish
        self._wishes = wishes
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
        """Waits for the try under way."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    @property
    def status(self) -> Status:
        with self._changed:
            return self._status

    @property
    def wanted(self) -> bool:
        """Whether clouds are of any use now."""
        with self._changed:
            return self._wanted

    def want(self) -> None:
        """Look for a fix (again), with a cloud that comes after this call."""
        with self._changed:
            self._wanted, self._cloud = True, None
            self._status = Status(State.WAITING)

    def on_cloud(self, body: bytes) -> None:
        """
        Args:
            body: a PointCloud2 in CDR. The newest counts; without a wish none does.
        """
        with self._changed:
            if self._wanted:
                self._cloud = body
                self._changed.notify()

    def on_imu(self, body: bytes) -> None:
        """
        Args:
            body: an Imu in CDR: at rest it tells which way is down.

        Raises:
            MalformedData, UnsupportedFormat: it is none.
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
                wish = self._status = replace(self._status, state=State.ASKING, tries=self._status.tries + 1)
            assert cloud is not None
            begin = time.monotonic()
            status = replace(self._try(cloud, wish), took_s=time.monotonic() - begin)
            with self._changed:
                if self._status is wish:  # nobody has asked anew meanwhile
                    self._status = status
                    self._wanted = status.state is not State.LOCALIZED
                    if not self._wanted:
                        self._cloud = None  # came while it asked
                self._changed.wait_for(lambda: self._closed, self._wishes.retry_s if self._wanted else 0)

    def _try(self, cloud: bytes, status: Status) -> Status:
        try:
            stamped = decode_point_cloud2(cloud, SCAN_LIMITS)
            answer = self._ask(stamped.scan(), self._options(stamped.header))
            if answer.T_map_sensor is None:
                return replace(status, state=State.NOT_LOCALIZED, answer=answer, error="")
            self._publish(to_pose_cdr(answer, stamped.header.stamp, self._wishes.map_frame), answer)
            return replace(status, state=State.LOCALIZED, answer=answer, error="")
        except (FirstfixError, ConnectionError) as error:
            return replace(status, state=State.FAILED, error=str(error))
        except Exception as error:  # a defect must not end the thread in silence
            return replace(status, state=State.FAILED, error=f"defect: {error!r}")

    def _options(self, header: Header) -> LocalizeOptions:
        options = self._wishes.options
        base = self._wishes.base_frame
        if base:
            mounting = self._lookup(base, header.frame_id)
            if mounting is None:  # the sensor's pose in its place would be a wrong one
                raise NotFound(f"no transform joins the frames {base!r} and {header.frame_id!r} (yet)")
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
