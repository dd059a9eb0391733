"""What the service answers, as models: the OpenAPI document is made of them."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from .answer_models import Position, Quaternion

_VERSION = "5a4ce3b4178946d0a2e1d4f1c3b7a9586e0f2d4c6b8a19375d3e5f7091b2c4d6"
_BUILD = "20250301t120000000000-1f2e3d4c"


def _example(**values: Any) -> ConfigDict:
    return ConfigDict(json_schema_extra={"examples": [values]})


class MapSummary(BaseModel):
    """A map that was published at least once."""

    model_config = _example(map_id="hall", active_version=_VERSION)
    map_id: str
    active_version: str | None = Field(description="what answers; null when every version is retired")


class MapPage(BaseModel):
    maps: list[MapSummary]
    next: str | None = Field(description="`after` of the next page; null: this is the last")


class MapDetails(MapSummary):
    versions: int = Field(description="how many can be served")
    manifest: dict[str, Any] = Field({}, description="of the active version; not there without one")


class VersionSummary(BaseModel):
    model_config = _example(version=_VERSION, active=True, published_time="2025-03-01T12:00:00+00:00")
    version: str
    active: bool
    published_time: str = Field(description="UTC, ISO 8601")


class VersionPage(BaseModel):
    map_id: str
    versions: list[VersionSummary] = Field(description="newest first")
    next: str | None = Field(description="`after` of the next page; null: this is the last")


class VersionDetails(BaseModel):
    map_id: str
    version: str
    active: bool
    manifest: dict[str, Any] = Field(description="all that the version is made of; its digest is its name")


class VersionReport(BaseModel):
    """What the build measured of itself."""

    map_id: str
    version: str
    counts: dict[str, int] = Field(description="templates, points of the map and so on")
    sensor: dict[str, Any] = Field(description="the scanner that the templates were simulated for")
    bounds: list[list[float]] = Field(description="lowest and highest local coordinates, metres")
    self_test: dict[str, Any] = Field(
        description="success, false accepts, `reliability` of the probabilities, and `localizability`: where "
        "in the map a robot can find itself and where not"
    )
    pictures: list[str] = Field(description="names of those that there are, beside this report")


class Activation(BaseModel):
    model_config = _example(map_id="hall", active_version=_VERSION, serving_version=_VERSION)
    map_id: str
    active_version: str
    serving_version: str = Field(description="another one only if the active one was refused")


class Retirement(BaseModel):
    model_config = _example(map_id="hall", version=_VERSION, active_version=None)
    map_id: str
    version: str
    active_version: str | None = Field(description="what answers now; null: nothing")


class BuildError(BaseModel):
    code: str
    detail: str


class Build(BaseModel):
    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={
            "examples": [
                {
                    "build_id": _BUILD,
                    "map_id": "hall",
                    "state": "running",
                    "stage": "simulate",
                    "progress": 0.41,
                    "error": None,
                    "version": None,
                }
            ]
        },
    )
    build_id: str
    map_id: str
    state: Literal["queued", "running", "succeeded", "failed", "cancelled", "unreadable"]
    stage: str
    progress: float = Field(ge=0, le=1)
    error: BuildError | None
    version: str | None = Field(description="digest, once it has succeeded")


class BuildPage(BaseModel):
    builds: list[Build] = Field(description="newest first")
    next: str | None = Field(
        description="`after` of the next page, also where this one is short; null: this is the last"
    )


class UploadStatus(BaseModel):
    model_config = _example(
        upload_id="u3f6c",
        file_name="hall.laz",
        size_bytes=5_000_000_000,
        offset_bytes=16_777_216,
        sha256=None,
        complete=False,
    )
    upload_id: str
    file_name: str
    size_bytes: int
    offset_bytes: int = Field(description="where to go on")
    sha256: str | None = Field(description="of the whole file, as its sender announced it")
    complete: bool


class GarbageReport(BaseModel):
    model_config = _example(
        dry_run=True,
        objects={"versions": 12, "sources": 1},
        keys={"versions": ["maps/hall/versions/..."], "sources": ["maps/hall/sources/..."]},
    )
    dry_run: bool = Field(description="nothing was removed")
    objects: dict[str, int] = Field(description="how many, by kind")
    keys: dict[str, list[str]] = Field(description="their keys, the first thousand of each kind")


class GeoreferenceBody(BaseModel):
    """Where a point of the map lies on the Earth and how the map is turned there: either `x_axis_deg`, for
    a map whose z axis points up, or `quaternion`."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"latitude_deg": 48.2649, "longitude_deg": 11.6713, "height_m": 529.4, "x_axis_deg": 30.0}
            ]
        },
    )
    latitude_deg: float = Field(ge=-90, le=90, description="WGS84")
    longitude_deg: float = Field(ge=-180, le=180, description="WGS84")
    height_m: float = Field(ge=-1e5, le=1e5, description="above the WGS84 ellipsoid, not above sea level")
    x_axis_deg: float | None = Field(
        None,
        ge=-360,
        le=360,
        description="where the map's x axis points, counter-clockwise from east: 0 is east, 90 is north. "
        "A compass heading h is 90 - h",
    )
    quaternion: Quaternion | None = Field(
        None, description="of length 1: turns map axes into east, north, up at the anchor"
    )
    anchor_m: Position = Field(
        [0.0, 0.0, 0.0],
        description="the point, in map coordinates: the map's origin, or for a map in projected coordinates "
        "(UTM) one in the middle of it",
    )


class GeoreferenceRecord(BaseModel):
    map_id: str
    latitude_deg: float
    longitude_deg: float
    height_m: float
    quaternion: Quaternion
    x_axis_deg: float
    anchor_m: Position


class Health(BaseModel):
    status: Literal["ok"]
    version: str = Field(description="of the service")


class CatalogHealth(BaseModel):
    age_s: float = Field(description="since it was read")
    error: str | None = Field(description="code of why it cannot be read")


class Holding(BaseModel):
    copies: int = Field(description="replicas that hold each map")
    replicas: int = Field(description="that share the maps, as this one sees it")
    maps: int = Field(description="that are this replica's to hold")
    loaded: int = Field(description="of those, in memory")


class Readiness(BaseModel):
    status: Literal["ready"]
    maps: int = Field(description="that are served")
    holding: Holding | None = Field(description="null: replicas share nothing")
    catalog: CatalogHealth
    queries: int = Field(description="that wait or run")
