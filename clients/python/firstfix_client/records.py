"""Records that the service and its replicas return: maps, versions, builds, replicas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from firstfix.findings.finding import Finding

FINAL_STATES = frozenset({"succeeded", "failed", "cancelled"})


@dataclass(frozen=True)
class MapInfo:
    """One map of the service.

    Attributes:
        active_version: digest of the version that answers; None when every version is retired.
        details: the service's whole record, unchanged.
    """

    map_id: str
    active_version: str | None
    details: Mapping[str, Any]

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> MapInfo:
        """Read the service's JSON."""
        active = data.get("active_version")
        return cls(str(data["map_id"]), None if active is None else str(active), dict(data))


@dataclass(frozen=True)
class VersionInfo:
    """One published version of a map.

    Attributes:
        published_time: UTC, ISO 8601.
        provisional: coarse and little tested, until the full version takes its place.
        details: the service's whole record, unchanged.
    """

    version: str
    active: bool
    published_time: str
    details: Mapping[str, Any]
    provisional: bool = False

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> VersionInfo:
        """Read the service's JSON."""
        return cls(
            str(data["version"]),
            bool(data["active"]),
            str(data.get("published_time", "")),
            dict(data),
            data.get("provisional") is True,
        )


@dataclass(frozen=True)
class BuildStatus:
    """State and progress of a build.

    Attributes:
        state: queued, running, succeeded, failed or cancelled; unreadable: its record in the store is
            damaged.
        progress: 0..1 within the stage.
        version: digest, once succeeded.
        error_code, error_detail: set when failed or unreadable.
        provisional_version: digest of the provisional version that the build has published, whatever its end.
        activated: whether the version was activated; False with a version: it is published only.
        findings: what is wrong or noteworthy with the map and its version, once succeeded.
        stages: of a build that has ended, where one build was asked for: ``stage``, ``seconds``, ``cached``,
            ``chunks`` and ``chunks_reused`` of each.
        waits_for: why a queued build does not begin; None: it begins in its turn.
    """

    build_id: str
    map_id: str
    state: str
    stage: str
    progress: float
    version: str | None
    error_code: str | None
    error_detail: str | None
    provisional_version: str | None = None
    stages: tuple[Mapping[str, Any], ...] = ()
    activated: bool = False
    findings: tuple[Finding, ...] = ()
    waits_for: str | None = None

    @property
    def is_final(self) -> bool:
        """True once the build has ended."""
        return self.state in FINAL_STATES

    @classmethod
    def from_mapping(cls, build_id: str, data: Mapping[str, Any]) -> BuildStatus:
        """Read the service's JSON."""
        error = data.get("error") or {}
        version, provisional = data.get("version"), data.get("provisional_version")
        return cls(
            build_id=build_id,
            map_id=str(data.get("map_id", "")),
            state=str(data["state"]),
            stage=str(data.get("stage", "")),
            progress=float(data.get("progress", 0.0)),
            version=None if version is None else str(version),
            error_code=str(error["code"]) if "code" in error else None,
            error_detail=str(error["detail"]) if "detail" in error else None,
            provisional_version=None if provisional is None else str(provisional),
            stages=tuple(dict(stage) for stage in data.get("stages", ())),
            activated=data.get("activated") is True,
            findings=tuple(Finding.from_mapping(one) for one in data.get("findings", ())),
            waits_for=data.get("waits_for"),
        )


@dataclass(frozen=True)
class ReplicaInfo:
    """One replica, as it describes itself over zenoh.

    Attributes:
        service_version: version of its software.
        maps: map id to the version that it answers with; None: none is loaded yet.
        queries, limit: queries that wait or run there, and the limit on them.
        held: number of maps that this replica holds; None: every replica holds all maps.
    """

    replica: str
    service_version: str
    maps: Mapping[str, str | None]
    queries: int
    limit: int
    held: int | None = None

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> ReplicaInfo:
        """Read the replica's JSON."""
        load, holding = data.get("load", {}), data.get("holding")
        return cls(
            str(data["replica"]),
            str(data.get("service_version", "")),
            dict(data.get("maps", {})),
            int(load.get("queries", 0)),
            int(load.get("limit", 0)),
            None if holding is None else int(holding["maps"]),
        )
