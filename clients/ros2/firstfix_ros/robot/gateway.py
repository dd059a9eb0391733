"""The gateway of one robot: asks by its policies, publishes fixes, and watches. It knows no transport."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

from firstfix.answer.localization import Localization, Verdict
from firstfix.errors import FirstfixError, InputError, MalformedData
from firstfix.ros import point_cloud2
from firstfix.ros.header import Header, Stamp
from firstfix.ros.pose_message import encode_pose
from firstfix.transform import inverse

from ..messages.diagnostic_array import encode_diagnostic_array
from ..messages.pose_array import encode_pose_array
from .answerer import Answerer
from .check import Checker
from .cloud_types import decode_cloud
from .config import GatewayConfig
from .first_fix import FirstFix
from .late_odometry import LateOdometry
from .map_to_odom import MapToOdom
from .query import Fix, Query
from .senses import Senses
from .status import State, Status, diagnosis_of
from .topics import Input, Output, Publish, Subscribers
from .watch import Health, Watch

MAX_CLOUD_BYTES = 128 * 2**20  # 2,000,000 points of 64 bytes
MAX_BODY_BYTES = 2**20  # of the other messages
LISTEN_AHEAD_S = 2.0  # clouds are heard so long before a check is due
SUSPECT_S = 0.5  # after a fix that contradicts the robot, the next check comes so soon
STATUS_S = 1.0


class RobotGateway:
    """One robot. Messages come in by ``take``, in any thread.

    ``run`` asks, in a thread of its own. ``tick`` publishes what is periodic.

    Args:
        ask: who answers the queries.
        publish: takes CDR messages, in the thread of ``step`` or of ``tick``.
        subscribers: tells how many subscribers an output has, in the same threads.
        log_line: takes a line when the state changes, or a message cannot be used.
        name: the robot's namespace.
        clock: seconds that never go back.
        wall_ns: nanoseconds since the epoch, for the stamps of the status.
    """

    def __init__(
        self,
        ask: Answerer,
        publish: Publish,
        config: GatewayConfig,
        *,
        subscribers: Subscribers = lambda output: None,
        log_line: Callable[[str], None] = lambda line: None,
        name: str = "",
        clock: Callable[[], float] = time.monotonic,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._ask, self._publish, self._config, self._log_line = ask, publish, config, log_line
        self._name, self._clock, self._wall_ns = name, clock, wall_ns
        self._changed = threading.Condition()
        self._senses = Senses(config.map_frame, config.odom_frame, config.base_frame)
        self._watch = Watch(config.astray_m, config.astray_deg) if config.watch_s else None
        watch = self._watch
        self._checker = None if watch is None else Checker(ask, self._senses, config, watch)
        self._map_to_odom = MapToOdom(config, self._senses)
        self._late_odometry = LateOdometry(config, self._senses)
        self._first_fix = FirstFix(name, config, self._senses, publish, subscribers, log_line, clock, wall_ns)
        self._cloud: tuple[str, bytes] | None = None  # its type, and the message
        self._status = Status(health=Health.UNKNOWN if config.watch_s else None)
        self._wanted, self._is_asked, self._closed, self._searches = False, False, False, 0
        self._next_try_s = self._next_check_s = self._next_status_s = clock()
        self._last_fix: Fix | None = None
        self._shows_hypotheses = False
        self._last_line, self._bad_message = "", ""
        if config.at_start:
            self._search(asked=False)

    @property
    def status(self) -> Status:
        """State and result of the last try."""
        with self._changed:
            given = self._first_fix
            return replace(self._status, epoch=given.epoch, pose_stamp=given.pose_stamp, stage=given.stage)

    @property
    def wanted(self) -> bool:
        """True while a fix is searched for."""
        with self._changed:
            return self._wanted

    @property
    def needs(self) -> frozenset[Input]:
        """Messages that are of use now. An edge need not subscribe to others."""
        with self._changed:
            ahead_s = self._clock() + LISTEN_AHEAD_S
            hears = self._wanted or (self._watch is not None and ahead_s >= self._next_check_s)
        needs = {Input.CLOUD, Input.IMU, Input.TF_STATIC} if hears else set()
        if self._watch is not None:
            needs |= {Input.TF, Input.TF_STATIC, Input.OWN_POSE}
        elif hears or self._first_fix.listens:
            needs |= {Input.TF, Input.OWN_POSE}
        elif self._map_to_odom.is_known:
            needs |= {Input.TF}
        elif self._late_odometry.is_awaited:
            needs |= {Input.TF, Input.TF_STATIC}
        return frozenset(needs)

    def relocalize(self) -> str:
        """Start a search (again), with a cloud that comes after this call. Returns a line for the caller."""
        self._search(asked=True)
        return "searching for a fix; its pose is published when it is found"

    def _search(self, *, asked: bool) -> None:
        """Start a search.

        Args:
            asked: somebody called for it, so that its fix is a new one in any case.
        """
        self._first_fix.forget()
        self._late_odometry.end()
        with self._changed:
            self._wanted, self._cloud, self._searches = True, None, self._searches + 1
            self._is_asked = asked
            self._next_try_s = self._clock()
            self._status = Status(State.WAITING, health=self._status.health, offset=self._status.offset)
            self._changed.notify_all()

    def set_times(self, retry_s: float, watch_s: float) -> None:
        """Set the times between two tries and between two checks, as in ``GatewayConfig``."""
        with self._changed:
            config = self._config = replace(self._config, retry_s=retry_s, watch_s=watch_s)
            self._next_check_s = self._clock()
            if (self._watch is not None) != bool(watch_s):
                self._watch = Watch(config.astray_m, config.astray_deg) if watch_s else None
                watch = self._watch
                self._checker = None if watch is None else Checker(self._ask, self._senses, config, watch)
                health = None if watch is None else Health.UNKNOWN
                self._status = replace(self._status, health=health, offset=None)
            self._changed.notify_all()

    def tell(self, error: str) -> None:
        """Tell why no cloud can be used now. The next one that comes is asked with, as ever."""
        with self._changed:
            if self._wanted and self._status.state is not State.ASKING:
                self._status = replace(self._status, state=State.FAILED, error=error)

    def take(self, kind: Input, body: bytes | memoryview, cloud_type: str = point_cloud2.TYPE) -> None:
        """Take a message, returns at once. A message that cannot be used is told once in a row, and dropped.

        A cloud replaces the one before, so a slow answer lets no queue grow.

        Args:
            cloud_type: of a cloud, one of CLOUD_TYPES.
        """
        try:
            most = MAX_CLOUD_BYTES if kind is Input.CLOUD else MAX_BODY_BYTES
            if len(body) > most:
                named = cloud_type if kind is Input.CLOUD else kind.ros_type
                raise MalformedData(f"{named}: {len(body)} bytes, the limit is {most}")
            if kind is not Input.CLOUD:
                self._senses.take(kind, body)
            elif kind in self.needs:
                with self._changed:
                    self._cloud = cloud_type, bytes(body)
                    self._changed.notify_all()
        except InputError as error:
            if str(error) != self._bad_message:
                self._bad_message = str(error)
                self._log_line(self._bad_message)

    def tick(self) -> None:
        """Publish map -> odom, and the status once a second. Call it about 10 times a second.

        The pose for the robot's localizer is published again until it follows.
        """
        if self._first_fix.tick():
            self._log_line(
                "a localizer has come, and the last fix is too old for it: searching for a new one"
            )
            self._search(asked=False)
        self._look_for_odometry()
        self._report()
        body = self._map_to_odom.message()
        if body is not None:
            self._publish(Output.TF, body)

    def _look_for_odometry(self) -> None:
        """Completes the last wanted fix by odometry that is heard only now, or searches anew."""
        late = self._late_odometry.look()
        if late.completed is not None:
            self._map_to_odom.set(late.completed)
            self._first_fix.complete(late.completed)
        elif late.search:
            self._log_line("odometry has begun after the last fix: searching for a new one")
            self._search(asked=False)

    def _report(self) -> None:
        """Tell and publish the status when it has changed, and publish it once a second."""
        with self._changed:
            status, now_s = self.status, self._clock()
            line = self._last_line if status.state is State.ASKING else status.line
            changed, self._last_line = line != self._last_line, line
            due = changed or now_s >= self._next_status_s
            if due:
                self._next_status_s = now_s + STATUS_S
        if changed:
            self._log_line(line)
        if due:
            header = Header(Stamp.of_ns(self._wall_ns()), "")
            body = encode_diagnostic_array(
                header, [diagnosis_of(status, self._name, self._map_to_odom.missing)]
            )
            self._publish(Output.STATUS, body)

    def run(self) -> None:
        """Ask whenever a query is due and a cloud is there, until ``close`` is called."""
        while True:
            with self._changed:
                while not self._closed and not self._is_ready():
                    left_s = self._due_s() - self._clock()
                    self._changed.wait(None if self._cloud is None else max(0.001, min(left_s, 3600.0)))
                if self._closed:
                    return
            try:
                self.step()
            except Exception as error:  # of an edge that cannot publish: the next query may
                self._log_line(f"defect: {error!r}")

    def close(self) -> None:
        """Ends ``run`` after the current query."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def step(self) -> bool:
        """Ask with the newest cloud, if a query is due. Returns whether it was."""
        with self._changed:
            if not self._is_ready():
                return False
            cloud, self._cloud = self._cloud, None
            searching, search = self._wanted, self._searches
            if searching:
                tries = self._status.tries + 1
                self._status = replace(self._status, state=State.ASKING, tries=tries)
            before = self._status
        assert cloud is not None
        begin_s = self._clock()
        status = self._tried(cloud, before, searching=searching)
        now_s = self._clock()
        with self._changed:
            if self._watch is not None:
                status = replace(status, health=self._watch.health, offset=self._watch.offset)
            suspect = self._watch is not None and self._watch.health is Health.SUSPECT
            watch_s = self._config.watch_s
            self._next_check_s = now_s + (min(SUSPECT_S, watch_s) if suspect else watch_s)
            if search == self._searches:  # nobody asked anew meanwhile
                self._next_try_s = now_s + self._config.retry_s
                self._status = replace(status, took_s=now_s - begin_s)
                if searching and status.state is State.LOCALIZED:
                    self._wanted, self._cloud = False, None
        self._report()
        return True

    def _due_s(self) -> float:
        if self._wanted:
            return self._next_try_s
        return self._next_check_s if self._watch is not None else float("inf")

    def _is_ready(self) -> bool:
        return self._cloud is not None and self._clock() >= self._due_s()

    def _tried(self, cloud: tuple[str, bytes], status: Status, *, searching: bool) -> Status:
        """The status after a try."""
        try:
            query = Query(decode_cloud(*cloud), self._senses, self._config)
            checker = self._checker
            if searching or checker is None:
                answer = query.ask(self._ask)
                fix = query.fix(answer)
            else:
                answer, fix = checker.check(query, self._last_fix)
            if not searching or self._is_awaited(status):
                self._publish_answer(query, answer, fix, wanted=searching)
            state = State.NOT_LOCALIZED if fix is None else State.LOCALIZED
            return replace(status, state=state, answer=answer, error="")
        except (FirstfixError, ConnectionError) as error:
            text = str(error)
        except Exception as error:  # a defect must not end the thread in silence
            text = f"defect: {error!r}"
        return replace(status, state=State.FAILED, error=text)

    def _is_awaited(self, status: Status) -> bool:
        """Whether nobody asked anew since the search with this status began."""
        with self._changed:
            return self._status is status

    def _publish_answer(self, query: Query, answer: Localization, fix: Fix | None, *, wanted: bool) -> None:
        """Publish a pose, or hypotheses. Only a wanted fix moves the robot."""
        header = Header(query.header.stamp, self._config.map_frame)
        if fix is not None:
            self._last_fix = fix
            if wanted:
                watch = self._watch  # ``set_times`` may take it away
                if watch is not None:
                    watch.reset()
                self._map_to_odom.set(fix)
                self._late_odometry.begin(fix)
                self._first_fix.give(fix, answer, asked=self._is_asked)
            pose = encode_pose(fix.T_map_frame, fix.covariance, header)
            self._publish(Output.POSE, pose)
        poses = []
        if answer.verdict is Verdict.AMBIGUOUS:
            mounting = query.T_frame_sensor
            poses = [
                h.T_map_sensor if mounting is None else h.T_map_sensor @ inverse(mounting)
                for h in answer.hypotheses
            ]
        if poses or self._shows_hypotheses:  # an empty array takes the old ones off a screen
            self._shows_hypotheses = bool(poses)
            self._publish(Output.HYPOTHESES, encode_pose_array(header, poses))
