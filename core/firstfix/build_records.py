"""Builds in an object store: what was asked for, how far it is, whether somebody wants it stopped.

    builds/<build_id>/request.json   created once
    builds/<build_id>/status.json    replaced by whoever runs the build
    builds/<build_id>/cancel         there: stop
    builds/<build_id>/stages.json    how long each stage of the last run took, once it has ended
    builds/<build_id>/attempts/...   see ``firstfix.build_attempts``

One process at a time runs a build (its attempts see to that), so the status needs no precondition: what
the last run wrote is true.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from .errors import Conflict, NotFound, StoreError
from .ids import check_build_id, is_name
from .redact import redact
from .store import Store

STATES = ("queued", "running", "succeeded", "failed", "cancelled")
FINAL_STATES = frozenset({"succeeded", "failed", "cancelled"})


class BuildRecords:
    """Records of builds. Thread-safe. Every method raises InvalidOption for an id that is none."""

    def __init__(self, store: Store) -> None:
        self.store = store

    def put_build(self, build_id: str, request: Mapping[str, Any]) -> None:
        """Records a request; its status is ``queued`` from here on.

        Raises:
            Conflict: there is a build of that id.
        """
        if not self.store.put_new(_key(build_id, "request.json"), _to_json(request)):
            raise Conflict(f"there is a build {build_id} already")

    def build_ids(self) -> list[str]:
        """Every build on record, sorted."""
        return [name for name in self.store.folders("builds") if is_name(name)]

    def build_request(self, build_id: str) -> dict[str, Any]:
        """
        Raises:
            NotFound: no such build.
        """
        try:
            return _from_json(self.store.get(_key(build_id, "request.json")), build_id)
        except NotFound:
            raise NotFound(f"no build {build_id}") from None

    def build_status(self, build_id: str) -> dict[str, Any]:
        """``state``, ``stage``, ``progress`` (0..1), ``error`` ({code, detail} or None), ``version``
        (digest or None), ``map_id``.

        Raises:
            NotFound: no such build.
        """
        try:
            return _from_json(self.store.get(_key(build_id, "status.json")), build_id)
        except NotFound:
            request = self.build_request(build_id)
            return new_status("queued", map_id=str(request.get("map_id", "")))

    def set_build_status(self, build_id: str, status: Mapping[str, Any]) -> None:
        self.store.put(_key(build_id, "status.json"), _to_json(status))

    def build_stages(self, build_id: str) -> list[dict[str, Any]]:
        """``stage``, ``seconds`` and ``cached`` of each stage of the last run that ended, if any."""
        try:
            stages = _from_json(self.store.get(_key(build_id, "stages.json")), build_id)["stages"]
            return [dict(stage) for stage in stages]
        except NotFound:
            return []
        except (KeyError, TypeError, ValueError):
            raise StoreError(f"the stages of build {build_id} cannot be read") from None

    def set_build_stages(self, build_id: str, stages: Sequence[Mapping[str, Any]]) -> None:
        self.store.put(_key(build_id, "stages.json"), _to_json({"stages": [dict(stage) for stage in stages]}))

    def request_cancel(self, build_id: str) -> None:
        """Asks the build to stop; the worker looks for it once a second.

        Raises:
            NotFound: no such build.
            Conflict: it has ended.
        """
        state = self.build_status(build_id)["state"]
        if state in FINAL_STATES:
            raise Conflict(f"build {build_id} has {state}")
        self.store.put_new(_key(build_id, "cancel"), b"")

    def is_cancel_requested(self, build_id: str) -> bool:
        return self.store.exists(_key(build_id, "cancel"))


def new_status(
    state: str,
    *,
    map_id: str,
    stage: str = "",
    progress: float = 0.0,
    error: Mapping[str, str] | None = None,
    version: str | None = None,
) -> dict[str, Any]:
    """The form of status.json."""
    if state not in STATES:
        raise ValueError(f"no build state {state!r}")
    return {
        "state": state,
        "stage": stage,
        "progress": round(min(max(progress, 0.0), 1.0), 4),
        "error": None if error is None else {name: redact(text) for name, text in error.items()},
        "version": version,
        "map_id": map_id,
    }


def _key(build_id: str, name: str) -> str:
    return f"builds/{check_build_id(build_id)}/{name}"


def _to_json(record: Mapping[str, Any]) -> bytes:
    return json.dumps(record, sort_keys=True, allow_nan=False).encode("utf-8")


def _from_json(data: bytes, build_id: str) -> dict[str, Any]:
    try:
        record = json.loads(data)
    except ValueError:
        record = None
    if not isinstance(record, dict):
        raise StoreError(f"a record of build {build_id} is no JSON object")
    return record
