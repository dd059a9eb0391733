"""The client's calls about builds."""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import httpx

from firstfix.errors import BuildCancelled, BuildFailed, FirstfixError, NotFound

from .build_events import statuses
from .calls import Calls
from .records import BuildStatus
from .resumable_upload import remove_upload, upload_in_parts
from .retry import Deadline
from .retrying_http import parsed

POLL_S = 1.0
IN_PARTS_FROM_BYTES = 64 << 20


class BuildCalls(Calls):
    """Handing maps in, and following what becomes of them. Part of ``Client``."""

    def build_map(
        self,
        path: Path | str,
        map_id: str,
        *,
        config: Mapping[str, Any] | None = None,
        trajectory: Path | str | None = None,
        upload_timeout_s: float = 3600.0,
    ) -> BuildStatus:
        """Uploads a map file and starts its build; ``wait_for_build`` follows it.

        However often a connection breaks on the way, it is one build. Files of 64 MiB and more go in
        parts, of which none is sent twice.

        Args:
            config: of the build, as its YAML file would say it; None: the service's defaults.

        Raises:
            NotFound: no such file.
            InputError: the service cannot use the file or the config.
        """
        paths = {"source": Path(path)} | ({} if trajectory is None else {"trajectory": Path(trajectory)})
        for wanted in paths.values():
            if not wanted.is_file():
                raise NotFound(f"{wanted}: no such file")
        deadline = Deadline(upload_timeout_s)
        if sum(wanted.stat().st_size for wanted in paths.values()) < IN_PARTS_FROM_BYTES:
            answer = self._post_form(paths, map_id, config, deadline)
        else:
            answer = self._post_uploads(paths, map_id, config, deadline)
        build_id = answer.headers.get("Location", "").rstrip("/").rpartition("/")[2]
        if not build_id:
            raise FirstfixError("the service accepted the map but did not say which build it started")
        return self.build_status(build_id)

    def builds(self, *, map_id: str | None = None, state: str | None = None) -> Iterator[BuildStatus]:
        """Builds on record, newest first, asked for page by page as they are taken."""
        given = {"map_id": map_id, "state": state}
        params = {name: value for name, value in given.items() if value is not None}
        return self._pages("builds", _status_of, "builds", params=params)

    def build_status(self, build_id: str) -> BuildStatus:
        """
        Raises:
            NotFound: no such build.
        """
        answer = self._call("GET", "builds", build_id)
        return parsed(answer, lambda data: BuildStatus.from_mapping(build_id, data))

    def build_events(self, build_id: str, *, timeout_s: float = 24 * 3600.0) -> Iterator[BuildStatus]:
        """The build's status whenever it changes, as the service tells it; the last one is final.

        Raises:
            NotFound: no such build.
            DeadlineExceeded: it is not done yet; it goes on all the same.
        """
        return statuses(self._http, build_id, Deadline(timeout_s))

    def wait_for_build(
        self,
        build_id: str,
        *,
        progress: Callable[[BuildStatus], None] = lambda status: None,
        timeout_s: float = 24 * 3600.0,
    ) -> BuildStatus:
        """Waits for the build's version, telling ``progress`` about once a second.

        Raises:
            BuildFailed, BuildCancelled: it ended without a version.
            DeadlineExceeded: it is not done yet; it goes on all the same.
        """
        deadline = Deadline(timeout_s)
        while True:
            status = self.build_status(build_id)
            progress(status)
            if status.state == "succeeded":
                return status
            if status.state == "cancelled":
                raise BuildCancelled(f"build {build_id} was cancelled")
            if status.state == "failed":
                raise BuildFailed(status.error_detail or f"build {build_id} failed")
            time.sleep(min(POLL_S, deadline.remaining_s()))

    def cancel_build(self, build_id: str) -> None:
        """Asks a build to stop; it does so at its next tick.

        Raises:
            NotFound: no such build.
            Conflict: it has ended.
        """
        self._call("DELETE", "builds", build_id, repeatable=False)

    def _post_form(
        self, paths: Mapping[str, Path], map_id: str, config: Mapping[str, Any] | None, deadline: Deadline
    ) -> httpx.Response:
        fields = {"map_id": map_id} | ({} if config is None else {"config": json.dumps(config)})
        key = {"Idempotency-Key": uuid.uuid4().hex}
        with ExitStack() as opened:
            streams = {name: opened.enter_context(file.open("rb")) for name, file in paths.items()}

            def request(left_s: float) -> httpx.Request:
                for stream in streams.values():
                    stream.seek(0)
                files = {name: (file.name, streams[name]) for name, file in paths.items()}
                return self._http.request(
                    "POST", "maps", left_s=left_s, data=fields, files=files, headers=key
                )

            return self._http.send(request, deadline)

    def _post_uploads(
        self, paths: Mapping[str, Path], map_id: str, config: Mapping[str, Any] | None, deadline: Deadline
    ) -> httpx.Response:
        uploads = {name: upload_in_parts(self._http, file, deadline) for name, file in paths.items()}
        body: dict[str, Any] = {"map_id": map_id, "config": dict(config or {})}
        body |= {name: {"upload": upload_id} for name, upload_id in uploads.items()}
        key = {"Idempotency-Key": uuid.uuid4().hex}
        answer = self._http.send(
            lambda left_s: self._http.request("POST", "maps", left_s=left_s, json=body, headers=key), deadline
        )
        with suppress(FirstfixError, ConnectionError):  # the service removes it in a day
            for upload_id in uploads.values():
                remove_upload(self._http, upload_id, deadline)
        return answer


def _status_of(data: Mapping[str, Any]) -> BuildStatus:
    return BuildStatus.from_mapping(str(data["build_id"]), data)
