"""A build's server-sent events as statuses, over however many connections it takes."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

import httpx

from firstfix.errors import FirstfixError

from .records import BuildStatus
from .retry import Deadline
from .retrying_http import RetryingHttp

SILENCE_S = 60.0  # the service breaks its silence four times as often
PAUSE_S = 0.5


def statuses(http: RetryingHttp, build_id: str, deadline: Deadline) -> Iterator[BuildStatus]:
    """Every status that differs from the one before, until a final one.

    Raises:
        NotFound: no such build.
        DeadlineExceeded: the deadline passed first.
        ServiceUnreachable: no service, after every retry.
    """

    def request(left_s: float) -> httpx.Request:
        return http.request("GET", "builds", build_id, "events", left_s=min(left_s, SILENCE_S))

    said: BuildStatus | None = None
    while True:
        answer = http.send(request, deadline, stream=True)
        try:
            for line in answer.iter_lines():
                deadline.remaining_s()
                if not line.startswith("data:"):
                    continue
                status = _status(build_id, line.removeprefix("data:"))
                if status != said:
                    said = status
                    yield status
                if status.is_final:
                    return
        except httpx.TransportError:  # broken, or silent for too long: asked again
            pass
        finally:
            answer.close()
        time.sleep(min(PAUSE_S, deadline.remaining_s()))


def _status(build_id: str, data: str) -> BuildStatus:
    try:
        return BuildStatus.from_mapping(build_id, json.loads(data))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FirstfixError(f"an event of build {build_id} cannot be read: {error!r}") from None
