"""Schemas of the answer, for the OpenAPI document. ``Localization.to_mapping`` makes the answer itself."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from firstfix.answer.localization import Reason
from firstfix.findings.finding import Severity

_POSE: JsonDict = {"position": [12.31, -4.02, 0.98], "quaternion": [0.0, 0.0, 0.3827, 0.9239]}
Position = Annotated[list[float], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4, description="x, y, z, w")]


class Pose(BaseModel):
    """Position and orientation."""

    position: Position = Field(description="metres")
    quaternion: Quaternion


class Twist(BaseModel):
    """Motion of the sensor."""

    linear: Position = Field(description="x, y, z in m/s")
    angular: Position = Field(description="about x, y, z in rad/s")


class FreeDirection(BaseModel):
    """A direction in which the scan leaves the pose free."""

    motion: Literal["translation", "rotation"] = Field(
        description="shift along the direction, or turn about it"
    )
    direction: Position = Field(description="unit vector in the map frame; its sign says nothing")
    sigma: float = Field(description="standard deviation: m of a translation, rad of a rotation")


class Hypothesis(BaseModel):
    """A possible pose, with the quality of its alignment."""

    T_map_sensor: Pose
    inlier_ratio: float = Field(description="share of the scan's points that lie on the map at this pose")
    alignment_score: float = Field(description="the inlier ratio, with closer matches counting more")
    free_space_violation: float = Field(
        description="share of directions that pass through a mapped surface and end where the map has nothing"
    )
    removed_surface: float = Field(
        description="share of directions that pass through a mapped surface and end at another one"
    )
    seen_free: float | None = Field(
        None,
        description="share of the scan's points in space that the mapping run saw free; null: not known",
    )
    probability: float
    template: int
    map_id: str


class Hint(BaseModel):
    """A move that should tell the best hypotheses of an ambiguous answer apart."""

    T_sensor_goal: Pose = Field(
        description="pose at which to take the next scan, in the sensor's frame at the query's last scan; "
        "the way there is level and straight"
    )
    distance_m: float = Field(description="length of the way; 0: turn on the spot")
    turn_deg: float = Field(description="turn about the vertical at the goal, to the left if positive")
    separation: float = Field(
        description="0 to 1: by how much a scan at the goal should fit the true place better than its best "
        "rival"
    )
    tells_apart: list[int] = Field(description="numbers of the hypotheses that it tells apart, 0: the first")


class Finding(BaseModel):
    """Fault of a scan or a map, or something noteworthy about it, and what helps."""

    code: str = Field(description="stable name; the page that ``doc`` names lists them")
    severity: Severity
    text: str = Field(description="what was found, with its numbers")
    numbers: dict[str, float] = Field(description="what was measured, by name with unit")
    remedy: str = Field(description="what helps")
    doc: str = Field(description="path of the documents' page that tells more")


class ScanFacts(BaseModel):
    """Facts of the scan as it came; of several scans, the last one."""

    points: int = Field(description="points that came, with those that are no returns")
    valid: int = Field(description="of these, the finite ones within 1,000 m")
    in_range: int = Field(description="of these, those within the map's least and largest range")
    median_range_m: float | None = Field(description="of a part of the finite points")
    largest_range_m: float | None = Field(description="of a part of the valid points")
    rings: int | None = Field(description="elevations at which the points lie; null: in no rings")
    plane_ratio: float | None = Field(
        description="0 to 1: thickness of the points over their breadth, 0 of points in one plane"
    )
    time_span_s: float | None = Field(
        description="from the first to the last point; null: the times of the points are not known"
    )


class Answer(BaseModel):
    """Answer to a query. The pose is null unless the verdict is `localized`."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "verdict": "localized",
                    "reasons": [],
                    "findings": [],
                    "scan": {
                        "points": 65536,
                        "valid": 61211,
                        "in_range": 60873,
                        "median_range_m": 6.42,
                        "largest_range_m": 48.1,
                        "rings": 64,
                        "plane_ratio": 0.31,
                        "time_span_s": None,
                    },
                    "T_map_sensor": _POSE,
                    "T_map_base": None,
                    "covariance": [1e-4 if i % 7 == 0 else 0.0 for i in range(36)],
                    "degenerate": [],
                    "twist": None,
                    "probability": 0.998,
                    "hypotheses": [
                        {
                            "T_map_sensor": _POSE,
                            "inlier_ratio": 0.93,
                            "alignment_score": 0.81,
                            "free_space_violation": 0.004,
                            "removed_surface": 0.011,
                            "seen_free": 0.003,
                            "probability": 0.998,
                            "template": 4711,
                            "map_id": "",
                        }
                    ],
                    "hint": None,
                    "map_id": "hall",
                    "map_version": "5a4ce3b4178946d0a2e1d4f1c3b7a9586e0f2d4c6b8a19375d3e5f7091b2c4d6",
                    "map_provisional": False,
                    "fix_id": "6c1f0e7a9b2d4835",
                    "timings_ms": {"preprocess": 9.1, "search": 2.0, "register": 31.5},
                }
            ]
        }
    )
    verdict: Literal["localized", "ambiguous", "rejected"]
    reasons: list[Reason]
    findings: list[Finding] = Field(
        description="what is wrong or noteworthy with the scan, the cause first. Each answer that is not "
        "`localized` has one"
    )
    scan: ScanFacts | None = Field(description="null of a query without points")
    T_map_sensor: Pose | None
    T_map_base: Pose | None
    covariance: Annotated[list[float], Field(min_length=36, max_length=36)] | None = Field(
        description="6 x 6, row by row, over x, y, z and rotations about the map's axes (m, rad)"
    )
    degenerate: list[FreeDirection] = Field(
        description="directions whose standard deviation is above 0.2 m or 2 degrees, as along a corridor; "
        "the pose is right but for them. Empty without a pose"
    )
    twist: Twist | None = Field(
        description="motion of the sensor during the scan, in its frame at the scan's stamp; null without a "
        "pose, or where the times of the points are not known"
    )
    probability: float
    hypotheses: list[Hypothesis] = Field(description="sorted, the best one first")
    hint: Hint | None = Field(description="null unless ambiguous, or if no move within reach helps")
    map_id: str
    map_version: str
    map_provisional: bool = Field(
        description="the version is coarse, its probabilities not measured on this map; a full one will "
        "take its place"
    )
    fix_id: str = Field(
        description="the same for the same pose in the same version, as when a scan is sent again. Empty "
        "without a pose"
    )
    timings_ms: dict[str, float]


class GeoPosition(BaseModel):
    """Position on the Earth."""

    lat: float = Field(description="degrees, WGS84")
    lon: float = Field(description="degrees, WGS84")
    h: float = Field(description="metres above the WGS84 ellipsoid")


class GeoQuaternion(BaseModel):
    """Rotation of the body in the east-north-up frame."""

    x: float
    y: float
    z: float
    w: float


class GeoPose(BaseModel):
    """OGC GeoPose 1.0, Basic-Quaternion: the body's axes in the east-north-up frame at the position."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "position": {"lat": 48.26493, "lon": 11.67134, "h": 530.38},
                    "quaternion": {"x": 0.0, "y": 0.0, "z": 0.3827, "w": 0.9239},
                }
            ]
        }
    )
    position: GeoPosition
    quaternion: GeoQuaternion
