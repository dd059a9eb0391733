"""Requests about builds, with resumable uploads in parts (tus 1.0), and the reading of the answers."""

from __future__ import annotations

import base64
import hashlib
import json
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from firstfix.errors import BuildCancelled, BuildFailed, Conflict, FirstfixError, NotFound

from ..records import BuildStatus
from .http_sender import HttpAnswer, HttpRequest, HttpSender
from .send import Deadline
from .step import Emit, NextLine, Sleep, Steps, work

PART_BYTES = 16 << 20
_PART = {"Content-Type": "application/offset+octet-stream", "Tus-Resumable": "1.0.0"}


def upload_in_parts(http: HttpSender, path: Path, deadline: Deadline) -> Steps[str]:
    """Send the file and return the upload's id. Each part has its own retries.

    Raises:
        FirstfixError: from the service: no room, too large, too many uploads.
        ChecksumMismatch: the file changed in transfer, or while it was read.
        DeadlineExceeded, ServiceUnreachable: see ``send.send``.
    """
    size = path.stat().st_size
    described = {"filename": path.name, "sha256": (yield from work(partial(_sha256, path)))}
    metadata = ",".join(f"{name} {_base64(value.encode())}" for name, value in described.items())
    headers = {"Upload-Length": str(size), "Upload-Metadata": metadata, "Tus-Resumable": "1.0.0"}
    begin = HttpRequest("POST", ("uploads",), headers=headers)
    upload_id = (yield from http.send_same(begin, deadline)).last_of_location
    if not upload_id:
        raise FirstfixError("the service accepted the upload but returned no upload id")
    offset = 0
    while offset < size:
        request = yield from work(partial(_part, path, upload_id, offset))
        try:
            answer = yield from http.send_same(request, deadline)
        except Conflict:  # the part arrived but its reply was lost: ask the service for the offset
            look = HttpRequest("HEAD", ("uploads", upload_id))
            answer = yield from http.send_same(look, deadline)
            if int(answer.headers["Upload-Offset"]) <= offset:
                raise
        offset = int(answer.headers["Upload-Offset"])
    return upload_id


def remove_upload(http: HttpSender, upload_id: str, deadline: Deadline) -> Steps[None]:
    """Remove an upload that is no longer needed."""
    request = HttpRequest("DELETE", ("uploads", upload_id))
    yield from http.send_same(request, deadline, repeatable=False)


def _part(path: Path, upload_id: str, offset: int) -> HttpRequest:
    with path.open("rb") as file:
        file.seek(offset)
        content = file.read(PART_BYTES)
    headers = {
        **_PART,
        "Upload-Offset": str(offset),
        "Upload-Checksum": f"sha256 {_base64(hashlib.sha256(content).digest())}",
    }
    return HttpRequest("PATCH", ("uploads", upload_id), headers=headers, content=content)


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


POLL_S = 1.0
IN_PARTS_FROM_BYTES = 64 << 20
SILENCE_S = 60.0  # limit for a silent event stream; the service writes four times as often
PAUSE_S = 0.5


class BuildSteps:
    """Calls of ``BuildCalls`` and ``AsyncBuildCalls`` as steps."""

    def __init__(self, http: HttpSender) -> None:
        self._http = http

    def build_map(
        self,
        path: Path | str,
        map_id: str,
        config: Mapping[str, Any] | None,
        trajectory: Path | str | None,
        note: str,
        progress: Callable[[BuildStatus], None] | None,
        upload_timeout_s: float,
        timeout_s: float,
    ) -> Steps[BuildStatus]:
        """Upload a map file and start its build."""
        paths = {"source": Path(path)} | ({} if trajectory is None else {"trajectory": Path(trajectory)})
        for wanted in paths.values():
            if not wanted.is_file():
                raise NotFound(f"{wanted}: no such file")
        asked = {"map_id": map_id, "config": dict(config or {}), "note": note}
        deadline = Deadline(upload_timeout_s)
        in_parts = sum(wanted.stat().st_size for wanted in paths.values()) >= IN_PARTS_FROM_BYTES
        answer = yield from (self._post_uploads if in_parts else self._post_form)(paths, asked, deadline)
        if not answer.last_of_location:
            raise FirstfixError("the service accepted the map but returned no build id")
        if progress is not None:
            return (yield from self.wait_for_build(answer.last_of_location, progress, timeout_s))
        return (yield from self.build_status(answer.last_of_location))

    def builds(self, map_id: str | None, state: str | None) -> Steps[None]:
        """Emit the recorded builds."""
        given = {"map_id": map_id, "state": state}
        params = {name: value for name, value in given.items() if value is not None}
        return self._http.pages("builds", _status_of, "builds", params=params)

    def build_status(self, build_id: str) -> Steps[BuildStatus]:
        """Get the state of a build."""
        answer = yield from self._http.call("GET", "builds", build_id)
        return answer.parsed(lambda data: BuildStatus.from_mapping(build_id, data))

    def build_events(self, build_id: str, timeout_s: float) -> Steps[None]:
        """Emit every new status. Reconnects as often as needed."""
        deadline = Deadline(timeout_s)
        request = HttpRequest("GET", ("builds", build_id, "events"))
        last: BuildStatus | None = None
        while True:
            patient = Deadline(min(deadline.remaining_s(), SILENCE_S))
            yield from self._http.send_same(request, patient, stream=True)
            line: str | None
            while (line := (yield NextLine())) is not None:
                deadline.remaining_s()
                if not line.startswith("data:"):
                    continue
                status = _status_in(build_id, line.removeprefix("data:"))
                if status != last:
                    last = status
                    yield Emit(status)
                if status.is_final:
                    return
            yield Sleep(min(PAUSE_S, deadline.remaining_s()))  # then reconnect

    def wait_for_build(
        self, build_id: str, progress: Callable[[BuildStatus], None], timeout_s: float
    ) -> Steps[BuildStatus]:
        """Wait until the build has published its version."""
        deadline = Deadline(timeout_s)
        while True:
            status = yield from self.build_status(build_id)
            progress(status)
            if status.state == "succeeded":
                return status
            if status.state == "cancelled":
                raise BuildCancelled(f"build {build_id} was cancelled")
            if status.state in ("failed", "unreadable"):
                raise BuildFailed(status.error_detail or f"build {build_id} failed")
            yield Sleep(min(POLL_S, deadline.remaining_s()))

    def cancel_build(self, build_id: str) -> Steps[None]:
        """Cancel a build."""
        yield from self._http.call("DELETE", "builds", build_id, repeatable=False)

    def _post_form(
        self, paths: Mapping[str, Path], asked: Mapping[str, Any], deadline: Deadline
    ) -> Steps[HttpAnswer]:
        fields = {**asked, "config": json.dumps(asked["config"])}
        request = HttpRequest("POST", ("maps",), headers=_once(), form=fields, files=paths)
        return self._http.send_same(request, deadline)

    def _post_uploads(
        self, paths: Mapping[str, Path], asked: Mapping[str, Any], deadline: Deadline
    ) -> Steps[HttpAnswer]:
        uploads: dict[str, str] = {}
        for name, file in paths.items():
            uploads[name] = yield from upload_in_parts(self._http, file, deadline)
        body = {**asked, **{name: {"upload": upload_id} for name, upload_id in uploads.items()}}
        request = HttpRequest("POST", ("maps",), headers=_once(), json=body)
        answer = yield from self._http.send_same(request, deadline)
        with suppress(FirstfixError, ConnectionError):  # the service removes it in a day
            for upload_id in uploads.values():
                yield from remove_upload(self._http, upload_id, deadline)
        return answer


def _once() -> dict[str, str]:
    """Headers that make a repeated request count once."""
    return {"Idempotency-Key": uuid.uuid4().hex}


def _status_of(data: Mapping[str, Any]) -> BuildStatus:
    return BuildStatus.from_mapping(str(data["build_id"]), data)


def _status_in(build_id: str, data: str) -> BuildStatus:
    try:
        return BuildStatus.from_mapping(build_id, json.loads(data))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FirstfixError(f"an event of build {build_id} cannot be read: {error!r}") from None
