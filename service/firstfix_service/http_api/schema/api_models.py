"""Models of the service's answers, for validation and for the OpenAPI document."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from .answer_models import Finding, Position, Quaternion

_VERSION = "5a4ce3b4178946d0a2e1d4f1c3b7a9586e0f2d4c6b8a19375d3e5f7091b2c4d6"
_BUILD = "20250301t120000000000-1f2e3d4c"


def _example(**values: Any) -> ConfigDict:
    return ConfigDict(json_schema_extra={"examples": [values]})


class Threshold(BaseModel):
    """Promise of a version's answers."""

    min_probability: float = Field(description="an answer is `localized` from here on")
    max_false_accept: float = Field(description="share of wrong answers that the config allows")
    bound: float | None = Field(None, description="share that was shown, with 95 % confidence")
    kept_by: str | None = Field(None, description="`rate`, `many maps` or `each answer`")


class VersionNumbers(BaseModel):
    """Numbers by which versions are told apart. Empty for a version that did not record them."""

    sensor: str | None = Field(None, description="name of the sensor model of its templates")
    size_m: list[float] | None = Field(None, description="extent along x, y and z, metres")
    templates: int | None = None
    found: float | None = Field(None, description="share of the self-test's scans whose place was found")
    localized: float | None = Field(None, description="share of the self-test's scans that were localized")
    false_accepts: int | None = Field(
        None, description="number of the self-test's answers that were localized and wrong"
    )
    threshold: Threshold | None = None


class Provenance(BaseModel):
    """Provenance of a version: its source and its maker. A text is empty where it is not known."""

    file_name: str = ""
    size_bytes: int = Field(0, description="of the source; 0: not known")
    sha256: str = Field("", description="of the source's file; empty for a folder")
    trajectory: str = Field("", description="file name of the poses of the mapping run")
    note: str = Field("", description="as its maker wrote it")
    release: str = Field("", description="of firstfix, which built it")
    caller: str | None = Field(
        None, description="who asked for the build; for `admin`, and for the caller itself"
    )
    host: str | None = Field(None, description="machine that built it; as `caller`")
    command: str | None = Field(None, description="command line or request; as `caller`")


class MapFinding(Finding):
    """Fault of a map or a version, or something noteworthy about it, and what helps."""

    places: list[list[float]] = Field(
        [], description="some points x, y, z where it shows, in the coordinates of the map's file"
    )


class MapSummary(BaseModel):
    """A map that was published at least once."""

    model_config = _example(
        map_id="hall",
        active_version=_VERSION,
        published_time="2025-03-01T12:00:00+00:00",
        summary={"sensor": "os0-64", "size_m": [35.4, 62.2, 11.5], "localized": 0.95},
    )
    map_id: str
    active_version: str | None = Field(description="version that answers; null: every version is retired")
    published_time: str | None = Field(None, description="of the active version: UTC, ISO 8601")
    provisional: bool = Field(False, description="the active version is coarse and untested")
    summary: VersionNumbers = Field(description="of the active version")


class MapPage(BaseModel):
    """A page of maps."""

    maps: list[MapSummary]
    next: str | None = Field(description="`after` of the next page; null: this is the last page")


class MapDetails(MapSummary):
    """A map with its active manifest."""

    versions: int = Field(description="number of published versions")
    provenance: Provenance = Field(
        default_factory=Provenance, description="of the active version; missing without one"
    )
    manifest: dict[str, Any] = Field({}, description="manifest of the active version; missing without one")


class MapRemoval(BaseModel):
    """A map that was taken out of service."""

    model_config = _example(map_id="hall", retired=[_VERSION])
    map_id: str
    retired: list[str] = Field(description="its versions, which are retired now")


class VersionSummary(BaseModel):
    """A published version."""

    model_config = _example(
        version=_VERSION, active=True, published_time="2025-03-01T12:00:00+00:00", provisional=False
    )
    version: str
    active: bool
    published_time: str = Field(description="UTC, ISO 8601")
    provisional: bool = Field(
        False, description="coarse and little tested: served until the build's full version takes its place"
    )
    provenance: Provenance
    summary: VersionNumbers


class VersionPage(BaseModel):
    """A page of versions."""

    map_id: str
    versions: list[VersionSummary] = Field(description="newest first")
    next: str | None = Field(description="`after` of the next page; null: this is the last page")


class VersionDetails(VersionSummary):
    """A version with its manifest."""

    map_id: str
    manifest: dict[str, Any] = Field(
        description="files and parameters of the version; its digest is the version's name"
    )


class CloudIndex(BaseModel):
    """The octree that holds the points of a version, for viewers."""

    low_m: tuple[float, float, float] = Field(description="low corner of the root, in map coordinates")
    edge_m: float = Field(description="edge of the root, metres")
    points: int = Field(description="number of points in all nodes")
    point_bytes: int
    normals: bool = Field(description="whether the points have normals")
    intensity: tuple[float, float] | None = Field(
        None,
        description="what 0 and 255 of the points' intensity stand for, in the unit of the map's file; "
        "without it they have none",
    )
    bounds_m: tuple[tuple[float, float, float], tuple[float, float, float]] = Field(
        description="lowest and highest coordinates of the points"
    )
    marks: dict[str, tuple[int, int]] = Field(
        description="`[first, count]` of what is no point of the map, packed as points of the root"
    )
    nodes: list[tuple[int, int, int, int, int, int]] = Field(
        description="`[level, x, y, z, first, count]`, parents before children"
    )


class Activation(BaseModel):
    """Active version of a map after a change."""

    model_config = _example(map_id="hall", active_version=_VERSION, serving_version=_VERSION)
    map_id: str
    active_version: str
    serving_version: str = Field(
        description="version that this replica serves; it differs only if the active version was refused"
    )


class Retirement(BaseModel):
    """A retired version."""

    model_config = _example(map_id="hall", version=_VERSION, active_version=None)
    map_id: str
    version: str
    active_version: str | None = Field(description="version that answers now; null: none")


class BuildError(BaseModel):
    """Reason of a failed build."""

    code: str
    detail: str


class BuildStage(BaseModel):
    """One stage of a build, and what it took over from earlier builds."""

    stage: str
    seconds: float
    cached: bool = Field(description="an earlier build had made all of it")
    chunks: int = Field(0, description="number of chunks of a stage that was made; 0: it has none")
    chunks_reused: int = Field(0, description="number of those that an earlier build had made")


class Build(BaseModel):
    """Status of a build."""

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
                    "provisional_version": _VERSION,
                    "stages": [],
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
    version: str | None = Field(description="digest of the built version; null until the build has succeeded")
    activated: bool = Field(
        False, description="false with a version: it is published only, and a finding says why"
    )
    findings: list[MapFinding] = Field(
        [],
        description="what is wrong or noteworthy with the map and its version, once the build has succeeded",
    )
    provisional_version: str | None = Field(
        None,
        description="digest of the provisional version that the build has published, also if it failed later",
    )
    waits_for: str | None = Field(
        None,
        description="of a queued build: why it does not begin, as far as the service sees that was asked; "
        "null: it begins in its turn",
    )
    stages: list[BuildStage] = Field(
        [], description="stages that have ended, in `GET /builds/{build_id}`; else empty"
    )
    file_name: str = Field("", description="of the source, in `GET /builds/{build_id}`")
    note: str = Field("", description="of the caller, in `GET /builds/{build_id}`")
    caller: str | None = Field(
        None,
        description="who asked for it, in `GET /builds/{build_id}`; for `admin`, and for the caller itself",
    )


class BuildPage(BaseModel):
    """A page of builds."""

    builds: list[Build] = Field(description="newest first")
    next: str | None = Field(
        description="`after` of the next page, even if this page is short; null: this is the last page"
    )


class UploadStatus(BaseModel):
    """State of an upload."""

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
    offset_bytes: int = Field(description="bytes received: continue here")
    sha256: str | None = Field(description="digest of the whole file, as announced by the sender")
    complete: bool


class GarbageReport(BaseModel):
    """Removed objects."""

    model_config = _example(
        dry_run=True,
        objects={"versions": 12, "sources": 1},
        keys={"versions": ["maps/hall/versions/..."], "sources": ["maps/hall/sources/..."]},
    )
    dry_run: bool = Field(description="true: nothing was removed")
    objects: dict[str, int] = Field(description="number of objects of each kind")
    keys: dict[str, list[str]] = Field(description="keys of the objects, the first 1000 of each kind")


class GeoreferenceBody(BaseModel):
    """Position of a map's anchor point on the Earth, and the map's rotation there.

    The rotation is either `x_axis_deg`, for a map whose z axis points up, or `quaternion`.
    """

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
        description="direction of the map's x axis, counter-clockwise from east: 0 is east, 90 is north. "
        "For a compass heading h it is 90 - h",
    )
    quaternion: Quaternion | None = Field(
        None, description="unit quaternion that rotates map axes to east, north, up at the anchor"
    )
    anchor_m: Position = Field(
        [0.0, 0.0, 0.0],
        description="point in map coordinates: the origin, or in a map with projected coordinates (UTM) "
        "a point near its centre",
    )


class GeoreferenceRecord(BaseModel):
    """Georeference of a map."""

    map_id: str
    latitude_deg: float
    longitude_deg: float
    height_m: float
    quaternion: Quaternion
    x_axis_deg: float
    anchor_m: Position


class Health(BaseModel):
    """Liveness of the service."""

    status: Literal["ok"]
    version: str = Field(description="release of the service")


class CatalogHealth(BaseModel):
    """State of the catalog."""

    age_s: float = Field(description="seconds since the catalog was read")
    error: str | None = Field(description="error code if it cannot be read")


class Holding(BaseModel):
    """Maps that this replica holds, where replicas share the maps."""

    copies: int = Field(description="number of replicas that hold each map")
    replicas: int = Field(description="number of replicas that share the maps, as seen by this one")
    maps: int = Field(description="number of maps assigned to this replica")
    loaded: int = Field(description="number of those in memory")


class Readiness(BaseModel):
    """Readiness of the service."""

    status: Literal["ready"]
    maps: int = Field(description="number of served maps")
    holding: Holding | None = Field(description="null: the replicas do not share the maps")
    catalog: CatalogHealth
    queries: int = Field(description="number of queries that wait or run")
    builds_wait_for: str | None = Field(
        None, description="why no build begins; null: they begin in turn, or another service runs them"
    )


class Caller(BaseModel):
    """The caller of a request, and what it may do."""

    model_config = _example(
        name="key:ops1", scopes=["build", "localize"], maps=["hall*"], authentication=True, read_only=False
    )
    name: str = Field(description="as in the logs")
    scopes: list[str] = Field(description="every scope that the caller has, those included by others too")
    maps: list[str] = Field(description="patterns of the ids of the maps that it sees")
    authentication: bool = Field(description="false: the service asks nobody for a key")
    read_only: bool = Field(description="true: the service refuses all changes")


class Sensor(BaseModel):
    """A sensor model: the rays of a LiDAR and its mounting."""

    name: str
    elevations_deg: list[float] = Field(description="one for each beam")
    azimuth_step_deg: float
    min_range_m: float
    max_range_m: float
    mount_height_m: float = Field(description="above the floor that the robot drives on")
    range_noise_m: float
    mount_roll_deg: float
    mount_pitch_deg: float
    pattern: Literal["rows", "rosette"]
    azimuth_fov_deg: float = Field(description="horizontal field of view of one scan")
