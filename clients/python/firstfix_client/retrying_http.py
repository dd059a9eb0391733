"""HTTP with retries inside one deadline, and the service's problems as errors."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar
from urllib.parse import quote

import httpx

from firstfix.errors import FirstfixError

from .errors import PASSING, ServiceUnreachable, error_of_problem
from .retry import Deadline, RetryPolicy, retry_after_s

CONNECT_TIMEOUT_S = 5.0
# Of a proxy that lost its upstream, which may have done its work: only what repeats safely is repeated.
_LOST_UPSTREAM = frozenset({502, 504})

Answer = TypeVar("Answer")


class RetryingHttp:
    """An httpx client whose every request ends in a successful answer or an error of ours. Thread-safe."""

    def __init__(self, http: httpx.Client, retry: RetryPolicy) -> None:
        self._http = http
        self._retry = retry

    def close(self) -> None:
        self._http.close()

    def send(
        self,
        request: Callable[[float], httpx.Request],
        deadline: Deadline,
        *,
        repeatable: bool = True,
        stream: bool = False,
    ) -> httpx.Response:
        """A successful answer, or the last failure when another try is not worth it or not safe.

        Args:
            request: makes the request of one attempt, from the seconds that are left.
            repeatable: it may be sent again although the service may have acted on it.
            stream: a successful answer's body is the caller's to read, and to close.

        Raises:
            FirstfixError: what the service's problem document stands for.
            DeadlineExceeded: the deadline passed.
            ServiceUnreachable: the last try reached nobody.
        """
        attempt = 0
        while True:
            attempt += 1
            asked_wait_s: float | None = None
            failure: Exception
            try:
                answer = self._http.send(request(deadline.remaining_s()), stream=stream)
                if stream and not answer.is_success:
                    answer.read()
            except (httpx.ConnectError, httpx.ConnectTimeout) as error:
                failure, again = self._unreachable(error), True
            except httpx.TimeoutException:
                raise deadline.exceeded() from None
            except httpx.TransportError as error:
                failure, again = self._unreachable(error), repeatable
            else:
                if answer.is_success:
                    return answer
                status = answer.status_code
                problem = error_of_problem(answer.content, status)
                failure = problem or FirstfixError(f"{answer.request.url} answered {status}")
                lost = problem is None and status in _LOST_UPSTREAM
                again = isinstance(problem, PASSING) or (repeatable and lost)
                asked_wait_s = retry_after_s(answer.headers.get("Retry-After"))
            wait_s = self._retry.wait_s(attempt, asked_wait_s)
            if not again or attempt >= self._retry.attempts or not deadline.allows(wait_s):
                raise failure from None
            time.sleep(wait_s)

    def request(self, method: str, *path: str, left_s: float, **content: Any) -> httpx.Request:
        """A request of at most ``left_s`` seconds; each part of the path is one segment of the URL."""
        url = "/".join(quote(segment, safe="") for segment in path)
        timeout = httpx.Timeout(left_s, connect=min(left_s, CONNECT_TIMEOUT_S))
        return self._http.build_request(method, url, timeout=timeout, **content)

    def _unreachable(self, error: Exception) -> ServiceUnreachable:
        return ServiceUnreachable(f"no answer from {self._http.base_url}: {error or type(error).__name__}")


def parsed(answer: httpx.Response, parse: Callable[[Any], Answer]) -> Answer:
    """What an answer's JSON says.

    Raises:
        FirstfixError: it is not what the protocol says: another service, or a proxy's page.
    """
    try:
        return parse(answer.json())
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FirstfixError(
            f"{answer.request.url} answered nothing this client can read: {error!r}"
        ) from None
