"""Records of builds in an object store: request, status, cancellation, and durations of stages.

    builds/<build_id>/request.json   created once
    builds/<build_id>/status.json    replaced by the process that runs the build
    builds/<build_id>/cancel         if it exists, the build is to stop
    builds/<build_id>/stages.json    duration of each stage of the last run that has ended
    builds/<build_id>/log.txt        end of the log of its processes, replaced whenever an attempt has ended
    builds/<build_id>/attempts/...   see ``firstfix.builds.attempts``

One process at a time runs a build (see ``firstfix.builds.attempts``), so the status needs no precondition:
the last run wrote the truth.

A build with a damaged request or status (``UnreadableRecord``) is listed as ``unreadable`` and is not run.
All other builds go on. ``firstfix.maintenance.repair`` repairs it or moves it aside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from ..errors import Conflict, NotFound, UnreadableRecord
from ..findings.finding import Finding
from ..ids import check_build_id, check_version, is_name
from ..store.json_record import RecordKind, read_record, record_json, text_of
from ..store.store import Store
from ..telemetry.redact import redact

STATES = ("queued", "running", "succeeded", "failed", "cancelled")
FINAL_STATES = frozenset({"succeeded", "failed", "cancelled"})
MAX_LOG_BYTES = 64 << 10
UNREADABLE = "unreadable"  # shown instead of a state, never recorded


class BuildRecords:
    """Records of builds. Thread-safe. Every method raises InvalidOption for an invalid id."""

    def __init__(self, store: Store) -> None:
        self.store = store

    def put(self, build_id: str, request: Mapping[str, Any]) -> None:
        """Record the request of a build, which is ``queued`` from now on.

        Raises:
            Conflict: a build has this id already.
        """
        if not self.store.put_new(_key(build_id, "request.json"), record_json(request)):
            raise Conflict(f"a build {build_id} exists already")

    def ids(self) -> list[str]:
        """Ids of all recorded builds, sorted."""
        return [name for name in self.store.folders("builds") if is_name(name)]

    def request(self, build_id: str) -> dict[str, Any]:
        """Request of a build.

        Raises:
            NotFound: no such build.
            UnreadableRecord: the request is damaged.
        """
        try:
            key = _key(build_id, "request.json")
            return read_record(self.store, key, RecordKind.BUILD_REQUEST, parse_request)
        except NotFound:
            raise NotFound(f"no build {build_id}") from None

    def status(self, build_id: str) -> dict[str, Any]:
        """Status of a build.

        Returns:
            ``state``, ``stage``, ``progress`` (0..1), ``error`` ({code, detail} or None), ``version`` and
            ``provisional_version`` (digest or None), ``activated``, ``findings`` and ``map_id``.

        Raises:
            NotFound: no such build.
            UnreadableRecord: the status is damaged, or there is none yet and the request is damaged.
        """
        try:
            key = _key(build_id, "status.json")
            return read_record(self.store, key, RecordKind.BUILD_STATUS, parse_status)
        except NotFound:
            request = self.request(build_id)
            return new_status("queued", map_id=request.get("map_id", ""))

    def shown_status(self, build_id: str) -> dict[str, Any]:
        """Status of a build for display. A build with a damaged record has the state ``unreadable``.

        Its map is then the one in the other record, if that can be read.

        Raises:
            NotFound: no such build.
        """
        try:
            return self.status(build_id)
        except UnreadableRecord as error:
            return {
                **new_status("failed", map_id=self._map_of(build_id)),
                "state": UNREADABLE,
                "error": {"code": error.code, "detail": "a record of this build is damaged"},
            }

    def status_or_queued(self, build_id: str) -> dict[str, Any]:
        """Status of a build, or ``queued`` if the status is damaged. For the process that will replace it."""
        try:
            return self.status(build_id)
        except UnreadableRecord:
            return new_status("queued", map_id=self._map_of(build_id))

    def _map_of(self, build_id: str) -> str:
        try:
            return str(self.request(build_id).get("map_id", ""))
        except (NotFound, UnreadableRecord):
            return ""

    def set_status(self, build_id: str, status: Mapping[str, Any]) -> None:
        """Replace the status of a build (``new_status``)."""
        self.store.put(_key(build_id, "status.json"), record_json(status))

    def stages(self, build_id: str) -> list[dict[str, Any]]:
        """Stages of the last run that have ended: ``stage``, ``seconds`` and ``cached`` of each.

        Raises:
            UnreadableRecord: their record is damaged.
        """
        try:
            return read_record(
                self.store, _key(build_id, "stages.json"), RecordKind.BUILD_STAGES, parse_stages
            )
        except NotFound:
            return []

    def set_stages(self, build_id: str, stages: Sequence[Mapping[str, Any]]) -> None:
        """Record the stages of a run that have ended."""
        record = record_json({"stages": [dict(stage) for stage in stages]})
        self.store.put(_key(build_id, "stages.json"), record)

    def log(self, build_id: str) -> str:
        """The end of the log of a build's processes, for people.

        Raises:
            NotFound: no such build, or no attempt at it has ended yet.
        """
        self.status(build_id)
        try:
            return self.store.get(_key(build_id, "log.txt"), max_bytes=MAX_LOG_BYTES).decode(errors="replace")
        except NotFound:
            raise NotFound(f"build {build_id} has no log: it is kept as an attempt ends") from None

    def set_log(self, build_id: str, text: str) -> None:
        """Keep the end of a log, without secrets."""
        kept = redact(text).encode()[-MAX_LOG_BYTES:]
        self.store.put(_key(build_id, "log.txt"), kept)

    def details(self, build_id: str) -> dict[str, Any]:
        """Status of a build for display, with its stages, and what it was asked for.

        Returns:
            As ``shown_status``, with ``stages``, ``file_name``, ``note`` and ``caller``; an unknown text is
            empty.

        Raises:
            NotFound: no such build.
        """
        shown: dict[str, Any] = {**self.shown_status(build_id), "stages": []}
        request: dict[str, Any] = {}
        with suppress(UnreadableRecord):  # for people: the build's state does not depend on it
            request = self.request(build_id)
        with suppress(UnreadableRecord):
            shown["stages"] = [] if shown["state"] == "queued" else self.stages(build_id)
        asked = {"file_name": "file_name", "note": "note", "caller": "owner"}
        return shown | {name: str(request.get(stored) or "") for name, stored in asked.items()}

    def request_cancel(self, build_id: str) -> None:
        """Ask a build to stop. The build worker checks for this once a second.

        Raises:
            NotFound: no such build.
            Conflict: the build has ended.
            UnreadableRecord: the status is damaged, so the build may have ended.
        """
        state = self.status(build_id)["state"]
        if state in FINAL_STATES:
            raise Conflict(f"build {build_id} has {state}")
        self.store.put_new(_key(build_id, "cancel"), b"")

    def is_cancel_requested(self, build_id: str) -> bool:
        """Whether the build is to stop."""
        return self.store.exists(_key(build_id, "cancel"))


def new_status(
    state: str,
    *,
    map_id: str,
    stage: str = "",
    progress: float = 0.0,
    error: Mapping[str, str] | None = None,
    version: str | None = None,
    provisional_version: str | None = None,
    activated: bool | None = None,
    findings: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Content of ``status.json``.

    Args:
        provisional_version: digest of the provisional version that the build has published, whatever its end.
        activated: whether the build has activated its version; None: where there is one.
        findings: JSON values of the findings of the map and of its version (``firstfix.findings``).
    """
    if state not in STATES:
        raise ValueError(f"no build state {state!r}")
    return {
        "state": state,
        "stage": stage,
        "progress": round(min(max(progress, 0.0), 1.0), 4),
        "error": None if error is None else {name: redact(text) for name, text in error.items()},
        "version": version,
        "provisional_version": provisional_version,
        "activated": version is not None if activated is None else activated,
        "findings": [dict(one) for one in findings],
        "map_id": map_id,
    }


def _key(build_id: str, name: str) -> str:
    return f"builds/{check_build_id(build_id)}/{name}"


def parse_request(record: dict[str, Any]) -> dict[str, Any]:
    """Parse the request of a build.

    Raises:
        ValueError, TypeError, KeyError, InvalidOption: it is not the request of a build.
    """
    map_id = text_of(record, "map_id", "")
    if map_id and not is_name(map_id):
        raise ValueError(f"map_id is {map_id[:80]!r}")
    for name in ("source", "trajectory"):
        named = record.get(name)
        if named is not None:
            for field in named:
                text_of(named, field)
    if (patch := record.get("patch")) is not None:
        check_version(text_of(patch, "base"))
        if text_of(patch, "mode") not in ("propose", "activate"):
            raise ValueError("mode of the patch is neither propose nor activate")
    if not isinstance(record.get("config") or {}, dict):
        raise TypeError("config is not an object")
    for name in ("file_name", "owner", "note", "command"):
        if record.get(name) is not None:
            text_of(record, name)
    return record


def parse_status(record: dict[str, Any]) -> dict[str, Any]:
    """Parse the status of a build.

    Raises:
        ValueError, TypeError, KeyError, InvalidOption: it is not the status of a build.
    """
    error, version, provisional = (record.get(n) for n in ("error", "version", "provisional_version"))
    if not isinstance(progress := record.get("progress", 0.0), int | float):
        raise TypeError("progress is not a number")
    if error is not None:
        error = {"code": text_of(error, "code"), "detail": text_of(error, "detail")}
    if (map_id := text_of(record, "map_id")) and not is_name(map_id):
        raise ValueError(f"map_id is {map_id[:80]!r}")
    return {
        **new_status(text_of(record, "state"), map_id=map_id, stage=text_of(record, "stage", "")),
        "progress": min(max(progress, 0.0), 1.0),
        "error": error,
        "version": None if version is None else check_version(version),
        "provisional_version": None if provisional is None else check_version(provisional),
        "activated": record["activated"] is True,
        "findings": [Finding.from_mapping(one).to_mapping() for one in record.get("findings", ())],
    }


def parse_stages(record: dict[str, Any]) -> list[dict[str, Any]]:
    """Parse the record of a build's stages.

    Raises:
        ValueError, TypeError, KeyError: it is not what ``set_stages`` records.
    """
    stages = [dict(stage) for stage in record["stages"]]
    for stage in stages:
        text_of(stage, "stage")
        float(stage["seconds"])
    return stages
