"""HTTP requests and answers, and how a request is sent: the route to the replicas and the policies."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

from firstfix.errors import FirstfixError, InvalidOption

from ..errors import error_of_problem
from ..policies import HedgePolicy, RetryPolicy
from .send import Deadline, Hedging, send
from .step import Answer, Emit, Outcome, Steps, lost, not_reached, refused, too_late

if TYPE_CHECKING:
    import httpx


Item = TypeVar("Item")
CONNECT_TIMEOUT_S = 5.0
MAX_RETRY_AFTER_S = 3600.0
# From a proxy that lost its upstream, which may have acted: only repeatable requests are sent again.
_LOST_UPSTREAM = frozenset({502, 504})


@dataclass(frozen=True)
class HttpRequest:
    """HTTP request to any replica.

    Attributes:
        path: segments of the URL's path, not yet quoted.
        json: the body, or
        content: the body, or
        form, files: parts of a multipart body.
    """

    method: str
    path: tuple[str, ...]
    params: Mapping[str, str] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    json: Any = None
    content: bytes | None = None
    form: Mapping[str, str] | None = None
    files: Mapping[str, Path] = field(default_factory=dict)

    def build(
        self, http: httpx.Client | httpx.AsyncClient, base_url: str, timeout_s: float, opened: ExitStack
    ) -> httpx.Request:
        """The request for httpx. Its files are closed with ``opened``."""
        import httpx

        files = {
            name: (path.name, opened.enter_context(path.open("rb"))) for name, path in self.files.items()
        }
        return http.build_request(
            self.method,
            f"{base_url}/{'/'.join(quote(segment, safe='') for segment in self.path)}",
            params=dict(self.params),
            headers=dict(self.headers),
            json=self.json,
            content=self.content,
            data=self.form,
            files=files or None,
            timeout=httpx.Timeout(timeout_s, connect=min(timeout_s, CONNECT_TIMEOUT_S)),
        )


@dataclass(frozen=True)
class HttpAnswer(Answer):
    """Successful HTTP answer.

    Attributes:
        headers: names are case-insensitive.
    """

    headers: Mapping[str, str]

    @property
    def last_of_location(self) -> str:
        """Id of the resource that was made."""
        return self.headers.get("Location", "").rstrip("/").rpartition("/")[2]


def outcome_of_response(
    target: str, response: httpx.Response, body: bytes, *, repeatable: bool, took_s: float
) -> Outcome:
    """Outcome of a call by its response.

    Args:
        body: empty for a successful stream.
    """
    url = str(response.url)
    if response.is_success:
        return Outcome(target, HttpAnswer(url, body, response.headers), took_s=took_s)
    status = response.status_code
    wait_s = retry_after_s(response.headers.get("Retry-After"))
    problem = error_of_problem(body, status)
    if problem is not None:
        return refused(target, problem, repeatable=repeatable, asked_wait_s=wait_s)
    failure = FirstfixError(f"{url} answered {status}")
    if status in _LOST_UPSTREAM:
        return lost(target, failure, repeatable=repeatable)
    return Outcome(target, failure=failure)


def outcome_of_error(target: str, error: httpx.RequestError, timeout_s: float, repeatable: bool) -> Outcome:
    """Outcome of a call without a response."""
    import httpx

    why = str(error) or type(error).__name__
    unreachable = not_reached(target, why)
    if isinstance(error, (httpx.ConnectError, httpx.ConnectTimeout)):
        return unreachable
    if isinstance(error, httpx.TimeoutException):
        return too_late(target, timeout_s, repeatable=repeatable)
    assert unreachable.failure is not None
    return lost(target, unreachable.failure, repeatable=repeatable)


def service_urls(given: str | Sequence[str]) -> list[str]:
    """The URLs of the replicas, without a trailing slash.

    Args:
        given: a list, or a string with commas.

    Raises:
        InvalidOption: one of them is not an HTTP URL, or there is none.
    """
    import httpx

    urls = given.split(",") if isinstance(given, str) else given
    found = []
    for url in urls:
        try:
            address = httpx.URL(url.strip())
        except httpx.InvalidURL as error:
            raise InvalidOption(f"not a URL: {url!r}: {error}") from None
        if address.scheme not in ("http", "https") or not address.host:
            raise InvalidOption(f"the service's URL must be like http://HOST:PORT, not {url!r}")
        found.append(str(address).rstrip("/"))
    if not found:
        raise InvalidOption("a client needs the URL of a service")
    return list(dict.fromkeys(found))


def retry_after_s(header: str | None) -> float | None:
    """The seconds of a Retry-After header; None if missing, a date, or invalid."""
    try:
        seconds = float(header or "")
    except ValueError:
        return None
    return seconds if 0 <= seconds <= MAX_RETRY_AFTER_S else None


class HttpRoute:
    """URLs of the service's replicas. One, picked at random, is asked until it fails."""

    def __init__(self, urls: Sequence[str]) -> None:
        self._urls = list(urls)
        random.shuffle(self._urls)  # robots with the same list spread over the replicas
        self._lock = threading.Lock()

    def order(self) -> list[str]:
        """All URLs, the one that answered last first."""
        with self._lock:
            return list(self._urls)

    def rival(self, target: str, others: list[str]) -> str | None:
        """The next URL; or the only one, since many replicas may stand behind it."""
        if others:
            return others[0]
        return target if len(self._urls) == 1 else None

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """None: a broken connection is noticed."""
        return None

    def answered(self, target: str) -> None:
        """Put this URL first."""
        with self._lock:
            place = self._urls.index(target)
            self._urls = self._urls[place:] + self._urls[:place]


class HttpSender:
    """Sends single requests, as steps.

    Args:
        hedge: when localizations are sent twice; None: by the default policy if there are several URLs;
            False: never.
        timeout_s: limit for a call that has no deadline of its own.
    """

    def __init__(
        self,
        urls: Sequence[str],
        retry: RetryPolicy | None,
        hedge: HedgePolicy | bool | None,
        timeout_s: float,
    ) -> None:
        self._route = HttpRoute(urls)
        self._retry = retry or RetryPolicy()
        if hedge is None:
            hedge = len(urls) > 1
        policy = HedgePolicy() if hedge is True else hedge
        self._hedging = Hedging(policy) if policy else None
        self.timeout_s = timeout_s

    def send(
        self,
        make: Callable[[float], HttpRequest],
        deadline: Deadline | None = None,
        *,
        repeatable: bool = True,
        stream: bool = False,
        hedged: bool = False,
    ) -> Steps[HttpAnswer]:
        """Send a request to the service, see ``send.send``."""
        return send(
            make,
            self._route,
            self._retry,
            deadline or Deadline(self.timeout_s),
            repeatable=repeatable,
            stream=stream,
            hedging=self._hedging if hedged else None,
        )

    def send_same(
        self, request: HttpRequest, deadline: Deadline | None = None, **how: bool
    ) -> Steps[HttpAnswer]:
        """Send a request that does not depend on the time left."""
        return self.send(lambda left_s: request, deadline, **how)

    def call(
        self,
        method: str,
        *path: str,
        params: Mapping[str, str] | None = None,
        json: Any = None,
        repeatable: bool = True,
    ) -> Steps[HttpAnswer]:
        """Send a request without a body, or with a short JSON body."""
        request = HttpRequest(method, path, params=params or {}, json=json)
        return self.send_same(request, repeatable=repeatable)

    def pages(
        self, name: str, read: Callable[[Any], Item], *path: str, params: Mapping[str, str] | None = None
    ) -> Steps[None]:
        """Emit the items of a paged list. Each page has the whole timeout."""
        after: str | None = None
        while True:
            asked = {**(params or {}), **({} if after is None else {"after": after})}
            answer = yield from self.call("GET", *path, params=asked)
            items, after = answer.parsed(lambda data: ([read(one) for one in data[name]], data.get("next")))
            for item in items:
                yield Emit(item)
            if after is None:
                return
