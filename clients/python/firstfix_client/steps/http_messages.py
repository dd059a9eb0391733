"""HTTP without a network: what is asked, what came back, and what that means."""

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
from .retry import retry_after_s

if TYPE_CHECKING:
    import httpx

CONNECT_TIMEOUT_S = 5.0
# Of a proxy that lost its upstream, which may have done its work: only what repeats safely is repeated.
_LOST_UPSTREAM = frozenset({502, 504})


@dataclass(frozen=True)
class HttpRequest:
    """
    Attributes:
        path: each part is one segment of the URL.
        json: the body, or
        content: the body, or
        form, files: of a multipart body.
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
        """The request as httpx sends it; its files are closed with ``opened``."""
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
    """
    Attributes:
        headers: case does not matter in their names.
    """

    headers: Mapping[str, str]

    @property
    def last_of_location(self) -> str:
        """The id of what was made."""
        return self.headers.get("Location", "").rstrip("/").rpartition("/")[2]


def outcome_of_response(
    target: str, response: httpx.Response, body: bytes, *, repeatable: bool, took_s: float
) -> Outcome:
    """
    Args:
        body: empty for a stream that succeeded.
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
    """What it means that there was no response."""
    import httpx

    why = str(error) or type(error).__name__
    reached_nobody = not_reached(target, why)
    if isinstance(error, (httpx.ConnectError, httpx.ConnectTimeout)):
        return reached_nobody
    if isinstance(error, httpx.TimeoutException):
        return too_late(target, timeout_s, repeatable=repeatable)
    assert reached_nobody.failure is not None
    return lost(target, reached_nobody.failure, repeatable=repeatable)


def service_urls(given: str | Sequence[str]) -> list[str]:
    """Addresses of replicas, without a slash at their end.

    Args:
        given: a list, or a text with commas between them.

    Raises:
        InvalidOption: one of them is no address, or there is none.
    """
    import httpx

    urls = given.split(",") if isinstance(given, str) else given
    found = []
    for url in urls:
        try:
            address = httpx.URL(url.strip())
        except httpx.InvalidURL as error:
            raise InvalidOption(f"no URL {url!r}: {error}") from None
        if address.scheme not in ("http", "https") or not address.host:
            raise InvalidOption(f"the service's URL is of the form http://HOST:PORT, not {url!r}")
        found.append(str(address).rstrip("/"))
    if not found:
        raise InvalidOption("a client needs the URL of a service")
    return list(dict.fromkeys(found))
