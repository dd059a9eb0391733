"""HTTP requests and answers, without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from firstfix.errors import FirstfixError, InvalidOption

from ..errors import error_of_problem
from .answer import Answer
from .outcome import Outcome, lost, not_reached, refused, too_late

if TYPE_CHECKING:
    import httpx

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
        """Returns the request for httpx. Its files are closed with ``opened``."""
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
    """Returns what a response means for the call.

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
    """Returns what a missing response means for the call."""
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
    """Returns the URLs of the replicas, without a trailing slash.

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
    """Returns the seconds of a Retry-After header; None if missing, a date, or invalid."""
    try:
        seconds = float(header or "")
    except ValueError:
        return None
    return seconds if 0 <= seconds <= MAX_RETRY_AFTER_S else None
