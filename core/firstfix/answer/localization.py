"""Answer to a query. "Not localized" is an answer without a pose: there is no fallback pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..findings.finding import Finding
from ..transform import pose_from_mapping, pose_to_mapping
from .free_direction import FreeDirection
from .hint import Hint
from .quality import AlignmentQuality
from .scan_facts import ScanFacts


class Verdict(str, Enum):
    """Outcome of a query."""

    LOCALIZED = "localized"
    AMBIGUOUS = "ambiguous"  # several poses explain the scan: see the hypotheses
    REJECTED = "rejected"


class Reason(str, Enum):
    """Cause of an answer that is not ``localized``."""

    TOO_FEW_POINTS = "too_few_points"
    NO_CANDIDATE = "no_candidate"
    LOW_INLIER_RATIO = "low_inlier_ratio"
    FREE_SPACE_VIOLATION = "free_space_violation"
    LOW_PROBABILITY = "low_probability"
    NOT_CONVERGED = "not_converged"  # the alignment was still moving when it was ended
    SEVERAL_PLACES = "several_places"
    WRONG_FRAME = "wrong_frame"  # the scan was not taken from its own origin: see the findings
    NOT_REGISTERED = "not_registered"  # the query had no points: the hypotheses are only candidates


@dataclass(frozen=True)
class Hypothesis:
    """One pose at which the scan may have been taken.

    Attributes:
        T_map_sensor: (4, 4), after registration; of a query without points, as the template implies it.
        quality: fit of the scan to the map at this pose; None: the query had no points.
        probability: 0..1, calibrated probability that this pose is right. Hypotheses that tie have equal
            shares.
        template: row of the template that led to it.
        map_id: map whose frame T_map_sensor is in, if several maps were asked.
    """

    T_map_sensor: NDArray[np.float64]
    quality: AlignmentQuality | None
    probability: float
    template: int
    map_id: str = ""


@dataclass(frozen=True)
class Localization:
    """Answer to one query.

    Attributes:
        verdict: outcome of the query.
        reasons: causes of an answer that is not localized.
        T_map_sensor: (4, 4) pose if localized, else None.
        T_map_base: (4, 4) pose of the robot's base if localized and the query had ``T_base_sensor``, else
            None.
        covariance: (6, 6) of the pose, over x, y, z, rotX, rotY, rotZ about the map's axes (m, rad),
            as in geometry_msgs/PoseWithCovariance; None without a pose.
        degenerate: directions of the map in which the scan leaves the pose free, as along a corridor. The
            pose is right but for them. Empty if there is none, or no pose.
        twist: (6,) motion of the sensor during the scan, if it was solved with the pose or given by the
            caller: m/s then rad/s, in the sensor frame at the scan's stamp. T_map_sensor is the pose at the
            stamp. None without a pose, or where the times of the scan's points are not known.
        probability: 0..1, probability that the best hypothesis or one that ties with it is right.
        hypotheses: competing poses, best first, whatever the verdict. Empty if there was no candidate.
        map_id: map whose frame the pose is in.
        map_version: digest of the version that answered.
        fix_id: of a localized answer: the same for the same pose in the same version, as when a scan is sent
            again; another one for another fix. Empty without a pose.
        timings_ms: milliseconds by stage.
        map_provisional: the version that answered is provisional: coarse, and its probabilities were not
            measured on this map. A full one will take its place.
        hint: a move that should tell the best hypotheses apart. None unless ambiguous, or if no move within
            reach does.
        findings: what is wrong or noteworthy with the scan, in words and with its remedy, weightiest first.
        scan: facts of the scan as it came. None of a query without points.
    """

    verdict: Verdict
    reasons: tuple[Reason, ...] = ()
    T_map_sensor: NDArray[np.float64] | None = None
    T_map_base: NDArray[np.float64] | None = None
    covariance: NDArray[np.float64] | None = None
    probability: float = 0.0
    hypotheses: tuple[Hypothesis, ...] = ()
    map_id: str = ""
    map_version: str = ""
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    twist: NDArray[np.float64] | None = None
    hint: Hint | None = None
    map_provisional: bool = False
    degenerate: tuple[FreeDirection, ...] = ()
    findings: tuple[Finding, ...] = ()
    scan: ScanFacts | None = None
    fix_id: str = ""

    def __post_init__(self) -> None:
        if (self.verdict is Verdict.LOCALIZED) != (self.T_map_sensor is not None):
            raise ValueError("a localized answer has a pose, and no other answer has a pose")

    def of_version(self, map_id: str, map_version: str, *, provisional: bool) -> Localization:
        """The answer with the version that gave it, and the id of its fix."""
        fix_id = "" if self.T_map_sensor is None else _fix_id(map_version, self.T_map_sensor)
        return replace(
            self, map_id=map_id, map_version=map_version, map_provisional=provisional, fix_id=fix_id
        )

    def to_mapping(self) -> dict[str, Any]:
        """Values ready for JSON, as both transports send them."""
        return {
            "verdict": self.verdict.value,
            "reasons": [reason.value for reason in self.reasons],
            "findings": [finding.to_mapping() for finding in self.findings],
            "scan": None if self.scan is None else self.scan.to_mapping(),
            "T_map_sensor": _optional_pose(self.T_map_sensor),
            "T_map_base": _optional_pose(self.T_map_base),
            "covariance": None if self.covariance is None else self.covariance.ravel().tolist(),
            "degenerate": [one.to_mapping() for one in self.degenerate],
            "twist": _twist_to_mapping(self.twist),
            "probability": self.probability,
            "hypotheses": [
                {
                    "T_map_sensor": pose_to_mapping(h.T_map_sensor),
                    "inlier_ratio": None if h.quality is None else h.quality.inlier_ratio,
                    "alignment_score": None if h.quality is None else h.quality.alignment_score,
                    "free_space_violation": None if h.quality is None else h.quality.free_space_violation,
                    "removed_surface": None if h.quality is None else h.quality.removed_surface,
                    "seen_free": None if h.quality is None else h.quality.seen_free,
                    "probability": h.probability,
                    "template": h.template,
                    "map_id": h.map_id,
                }
                for h in self.hypotheses
            ],
            "hint": None if self.hint is None else self.hint.to_mapping(),
            "map_id": self.map_id,
            "map_version": self.map_version,
            "map_provisional": self.map_provisional,
            "fix_id": self.fix_id,
            "timings_ms": {stage: round(ms, 3) for stage, ms in self.timings_ms.items()},
        }

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Localization:
        """Read what ``to_mapping`` returned. Unknown keys are ignored."""
        covariance = data.get("covariance")
        return cls(
            verdict=Verdict(data["verdict"]),
            reasons=tuple(Reason(reason) for reason in data.get("reasons", ())),
            T_map_sensor=_pose_from_mapping(data.get("T_map_sensor")),
            T_map_base=_pose_from_mapping(data.get("T_map_base")),
            covariance=None if covariance is None else np.asarray(covariance, np.float64).reshape(6, 6),
            probability=float(data.get("probability", 0.0)),
            hypotheses=tuple(
                Hypothesis(
                    pose_from_mapping(h["T_map_sensor"]),
                    _quality_from_mapping(h),
                    float(h["probability"]),
                    int(h["template"]),
                    str(h.get("map_id", "")),
                )
                for h in data.get("hypotheses", ())
            ),
            map_id=str(data.get("map_id", "")),
            map_version=str(data.get("map_version", "")),
            map_provisional=data.get("map_provisional") is True,
            fix_id=str(data.get("fix_id", "")),
            timings_ms=dict(data.get("timings_ms", {})),
            twist=_twist_from_mapping(data.get("twist")),
            hint=None if data.get("hint") is None else Hint.from_mapping(data["hint"]),
            degenerate=tuple(FreeDirection.from_mapping(one) for one in data.get("degenerate") or ()),
            findings=tuple(Finding.from_mapping(one) for one in data.get("findings") or ()),
            scan=None if data.get("scan") is None else ScanFacts.from_mapping(data["scan"]),
        )


def _fix_id(map_version: str, T_map_sensor: NDArray[np.float64]) -> str:
    numbers = np.ascontiguousarray(T_map_sensor, "<f8").tobytes()
    return blake2b(map_version.encode() + numbers, digest_size=8).hexdigest()


def _optional_pose(T: NDArray[np.float64] | None) -> dict[str, list[float]] | None:
    return None if T is None else pose_to_mapping(T)


def _pose_from_mapping(data: Mapping[str, Any] | None) -> NDArray[np.float64] | None:
    return None if data is None else pose_from_mapping(data)


def _twist_to_mapping(twist: NDArray[np.float64] | None) -> dict[str, list[float]] | None:
    return None if twist is None else {"linear": twist[:3].tolist(), "angular": twist[3:].tolist()}


def _twist_from_mapping(data: Mapping[str, Any] | None) -> NDArray[np.float64] | None:
    return None if data is None else np.array([*data["linear"], *data["angular"]], np.float64).reshape(6)


def _quality_from_mapping(data: Mapping[str, Any]) -> AlignmentQuality | None:
    if data["inlier_ratio"] is None:
        return None
    return AlignmentQuality(
        float(data["inlier_ratio"]),
        float(data["alignment_score"]),
        float(data["free_space_violation"]),
        float(data["removed_surface"]),
        seen_free=None if data.get("seen_free") is None else float(data["seen_free"]),
    )
