"""What the service says of maps, versions and builds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

FINAL_STATES = frozenset({"succeeded", "failed", "cancelled"})


@dataclass(frozen=True)
class MapInfo:
    """One map of the service.

    Attributes:
        active_version: digest of the version that answers; None when every version is retired.
        details: the service's whole record, as it came.
    """

    map_id: str
    active_version: str | None
    details: Mapping[str, Any]

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> MapInfo:
        active = data.get("active_version")
        return cls(str(data["map_id"]), None if active is None else str(active), dict(data))


@dataclass(frozen=True)
class VersionInfo:
    """One published version of a map.

    Attributes:
        published_time: UTC, ISO 8601.
        details: the service's whole record, as it came.
    """

    version: str
    active: bool
    published_time: str
    details: Mapping[str, Any]

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> VersionInfo:
        return cls(
            str(data["version"]), bool(data["active"]), str(data.get("published_time", "")), dict(data)
        )


@dataclass(frozen=True)
class BuildStatus:
    """How far a build is.

    Attributes:
        state: queued, running, succeeded, failed or cancelled; unreadable: its record in the store is
            damaged.
        progress: 0..1 within the stage.
        version: digest, once succeeded.
        error_code, error_detail: when failed or unreadable.
    """

    build_id: str
    map_id: str
    state: str
    stage: str
    progress: float
    version: str | None
    error_code: str | None
    error_detail: str | None

    @property
    def is_final(self) -> bool:
        return self.state in FINAL_STATES

    @classmethod
    def from_mapping(cls, build_id: str, data: Mapping[str, Any]) -> BuildStatus:
        error = data.get("error") or {}
        version = data.get("version")
        return cls(
            build_id=build_id,
            map_id=str(data.get("map_id", "")),
            state=str(data["state"]),
            stage=str(data.get("stage", "")),
            progress=float(data.get("progress", 0.0)),
            version=None if version is None else str(version),
            error_code=str(error["code"]) if "code" in error else None,
            error_detail=str(error["detail"]) if "detail" in error else None,
        )
