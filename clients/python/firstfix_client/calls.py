"""What every group of calls stands on: one request, retried within one deadline."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import httpx

from .retry import Deadline
from .retrying_http import RetryingHttp, parsed

Item = TypeVar("Item")


class Calls:
    """Attributes for the groups: ``_http``, and ``_timeout_s`` of one call as a whole."""

    _http: RetryingHttp
    _timeout_s: float

    def _call(self, method: str, *path: str, repeatable: bool = True, **content: Any) -> httpx.Response:
        return self._http.send(
            lambda left_s: self._http.request(method, *path, left_s=left_s, **content),
            Deadline(self._timeout_s),
            repeatable=repeatable,
        )

    def _pages(
        self, name: str, read: Callable[[Any], Item], *path: str, params: dict[str, str] | None = None
    ) -> Iterator[Item]:
        """The items of a list that comes in pages; each page has the whole timeout."""
        after: str | None = None
        while True:
            asked = {**(params or {}), **({} if after is None else {"after": after})}
            answer = self._call("GET", *path, params=asked)
            items, after = parsed(answer, lambda data: ([read(one) for one in data[name]], data.get("next")))
            yield from items
            if after is None:
                return
