"""Fetches one file from an HTTP server, in several attempts, and resumes what has arrived."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import httpx

from firstfix.errors import BuildFailed, NotFound, TooLarge

ATTEMPTS = 5
PAUSE_S = 1.0
TIMEOUT_S = 60.0  # without a byte


class _Broken(Exception):
    """A temporary failure of the connection or of the server.

    Attributes:
        etag: of the file whose beginning has arrived; empty: the download cannot be resumed.
    """

    def __init__(self, why: str, etag: str = "") -> None:
        super().__init__(why)
        self.etag = etag


def fetch_http(
    url: str, path: Path, max_bytes: int, on_progress: Callable[[float], None] = lambda done: None
) -> None:
    """Download a URL to a file, completely or not at all.

    An interrupted download resumes where it broke, if the server supports it. Redirects are not followed,
    because their targets were not checked.

    Args:
        on_progress: called while the file arrives, with the completed share, 0..1.

    Raises:
        NotFound: there is no file at the URL.
        TooLarge: the file exceeds the limit.
        BuildFailed: the server refuses, redirects, or fails repeatedly.
    """
    part = path.with_name(f".{path.name}.part")
    path.parent.mkdir(parents=True, exist_ok=True)
    part.unlink(missing_ok=True)
    etag = ""
    try:
        with httpx.Client(follow_redirects=False, timeout=TIMEOUT_S) as client:
            for attempt in range(1, ATTEMPTS + 1):
                try:
                    _fetch(client, url, part, max_bytes, etag, on_progress)
                    break
                except _Broken as error:
                    etag = error.etag
                    if attempt == ATTEMPTS:
                        raise BuildFailed(f"the source cannot be fetched from its server: {error}") from None
                    time.sleep(PAUSE_S * attempt)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _fetch(
    client: httpx.Client,
    url: str,
    part: Path,
    max_bytes: int,
    etag: str,
    on_progress: Callable[[float], None],
) -> None:
    """Make one attempt. It appends to the part if the server's file still has the ETag."""
    have = part.stat().st_size if part.exists() else 0
    headers = {"Accept-Encoding": "identity"}
    if have and etag:
        headers |= {"Range": f"bytes={have}-", "If-Range": etag}
    try:
        with client.stream("GET", url, headers=headers) as answer:
            goes_on = answer.status_code == 206
            _check(answer, f"bytes {have}-" if goes_on else "", etag)
            written = have if goes_on else 0
            expected = written + int(answer.headers.get("Content-Length", -1))
            if expected > max_bytes:
                raise TooLarge(f"the source has {expected} bytes, the limit is {max_bytes}")
            seen = answer.headers.get("ETag", "")
            etag = "" if seen.startswith("W/") else seen
            with part.open("ab" if goes_on else "wb") as file:
                for piece in answer.iter_raw():
                    written += len(piece)
                    if written > max_bytes:
                        raise TooLarge(f"the source has over {max_bytes} bytes")
                    file.write(piece)
                    on_progress(min(written / (expected if expected >= written else max_bytes), 1.0))
    except httpx.TransportError as error:
        raise _Broken(str(error) or type(error).__name__, etag) from None


def _check(answer: httpx.Response, expected_range: str, etag: str) -> None:
    status = answer.status_code
    if status >= 500 or status == 429:
        raise _Broken(f"it answered {status}", etag)
    if status in (404, 410):
        raise NotFound("there is nothing at the source's URL")
    if answer.is_redirect:
        raise BuildFailed("the source's URL redirects, and redirects are not followed: give the final URL")
    if status not in (200, 206) or not answer.headers.get("Content-Range", "").startswith(expected_range):
        raise BuildFailed(f"the source's server answered {status}")
