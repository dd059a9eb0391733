"""State of a robot's gateway, and the diagnosis of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.localization import Localization
from firstfix.ros.header import Stamp

from ..messages.diagnostic_array import ERROR, OK, WARN, Diagnosis
from .epoch import Epoch
from .handover import Stage
from .topics import NODE_NAME
from .watch import Health, Offset


class State(str, Enum):
    """State of the search for a fix."""

    IDLE = "idle"  # no fix is wanted, and there was none
    WAITING = "waiting"  # for a cloud
    ASKING = "asking"
    LOCALIZED = "localized"
    NOT_LOCALIZED = "not localized"  # the last cloud; the next one is tried
    FAILED = "failed"  # the last cloud was unusable, or nobody answered; the next one is tried


TASK = "pose in the map"
_LEVELS = {State.NOT_LOCALIZED: WARN, State.FAILED: ERROR}
_HEALTH_LEVELS = {Health.UNKNOWN: WARN, Health.ASTRAY: ERROR}


@dataclass(frozen=True)
class Status:
    """State and result of the last try.

    Attributes:
        tries: clouds sent since a fix was wanted last.
        answer: the last answer, None before the first.
        error: why the last try failed, or empty.
        took_s: duration of the last try.
        health: state of the robot's own localization; None if it is not watched.
        offset: from the robot's own pose to the last fix.
        epoch: of the last fix that was wanted; None before the first.
        pose_stamp: of the last pose that the localizer was sent under this epoch; None: there was none.
        stage: how far this fix has come on its way into the robot's localizer; None while another is sought.
    """

    state: State = State.IDLE
    tries: int = 0
    answer: Localization | None = None
    error: str = ""
    took_s: float = 0.0
    health: Health | None = None
    offset: Offset | None = None
    epoch: Epoch | None = None
    pose_stamp: Stamp | None = None
    stage: Stage | None = None

    @property
    def line(self) -> str:
        """State and health in words."""
        words = self.state.value + (f": {self.error}" if self.error else "")
        if self.state is State.NOT_LOCALIZED and self.answer is not None and self.answer.findings:
            words += f": {self.answer.findings[0].text}"
        if self.health is None or self.health is Health.UNKNOWN:
            return words
        away = ""
        if self.offset is not None and self.health is not Health.HEALTHY:
            away = f" by {self.offset.distance_m:.2f} m, {self.offset.angle_deg:.1f} deg"
        return f"{words}; own localization {self.health.value}{away}"


def _in_words(free: FreeDirection) -> str:
    """A free direction, as "translation (0.60, 0.80, 0.00) by 1.30 m"."""
    x, y, z = free.direction.tolist()
    is_turn = free.motion is Motion.ROTATION
    sigma = f"{math.degrees(free.sigma):.1f} deg" if is_turn else f"{free.sigma:.2f} m"
    return f"{free.motion.value} ({x:.2f}, {y:.2f}, {z:.2f}) by {sigma}"


def diagnosis_of(status: Status, hardware_id: str = "", missing_tf: str = "") -> Diagnosis:
    """The diagnosis for a status, named as diagnostic_updater does: node, then task.

    Args:
        hardware_id: the robot's namespace.
        missing_tf: frames between which a transform is missing, so that none is published.
    """
    level = _LEVELS.get(status.state, OK)
    values = {"state": status.state.value, "tries": str(status.tries), "took_s": f"{status.took_s:.3f}"}
    if missing_tf:  # no fault: a robot may have no odometry
        values["missing_tf"] = missing_tf
    if status.error:
        values["error"] = status.error[:500]
    if status.health is not None:
        level = max(level, _HEALTH_LEVELS.get(status.health, OK))
        values["own_localization"] = status.health.value
        if status.offset is not None:
            values["offset_m"] = f"{status.offset.distance_m:.3f}"
            values["offset_deg"] = f"{status.offset.angle_deg:.2f}"
    if status.epoch is not None:
        values["epoch"] = str(status.epoch)
    if status.pose_stamp is not None:
        values["pose_stamp"] = str(status.pose_stamp)
    if status.stage is not None:
        values["localizer"] = status.stage.value
    answer = status.answer
    if answer is not None:
        values |= {
            "verdict": answer.verdict.value,
            "reasons": ", ".join(reason.value for reason in answer.reasons),
            "findings": ", ".join(finding.code for finding in answer.findings),
            "remedy": answer.findings[0].remedy if answer.findings else "",
            "probability": f"{answer.probability:.3f}",
            "map_id": answer.map_id,
            "map_version": answer.map_version,
            "fix_id": answer.fix_id,
            "degenerate": ", ".join(_in_words(one) for one in answer.degenerate),
            "map_provisional": str(answer.map_provisional).lower(),
        }
    return Diagnosis(level, f"{NODE_NAME}: {TASK}", status.line[:500], hardware_id, values)
