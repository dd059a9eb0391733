"""What every call over HTTP stands on: the replicas, and how patiently they are asked."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from .hedge import HedgePolicy, Hedging
from .http_messages import HttpAnswer, HttpRequest
from .retry import Deadline, RetryPolicy
from .send import send
from .step import Emit, Steps

Item = TypeVar("Item")


class HttpRoute:
    """The service's addresses. One of them, at random at first, is asked until it fails."""

    def __init__(self, urls: Sequence[str]) -> None:
        self._urls = list(urls)
        random.shuffle(self._urls)  # a fleet that knows the same addresses spreads over them
        self._lock = threading.Lock()

    def order(self) -> list[str]:
        with self._lock:
            return list(self._urls)

    def rival(self, target: str, others: list[str]) -> str | None:
        """Behind a single address there may be many replicas: it is asked itself then."""
        if others:
            return others[0]
        return target if len(self._urls) == 1 else None

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """Nobody: a connection that breaks is seen."""
        return None

    def answered(self, target: str) -> None:
        with self._lock:
            place = self._urls.index(target)
            self._urls = self._urls[place:] + self._urls[:place]


class HttpSender:
    """Steps of single requests.

    Args:
        hedge: when localizations are asked twice; None: where there are several addresses, as the default
            policy says; False: never.
        timeout_s: of a call as a whole, where it says no other.
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
        """As ``send.send``, to the service."""
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
        """A request that is the same whenever it is made."""
        return self.send(lambda left_s: request, deadline, **how)

    def call(
        self,
        method: str,
        *path: str,
        params: Mapping[str, str] | None = None,
        json: Any = None,
        repeatable: bool = True,
    ) -> Steps[HttpAnswer]:
        """One without a body, or with a short one in JSON."""
        request = HttpRequest(method, path, params=params or {}, json=json)
        return self.send_same(request, repeatable=repeatable)

    def pages(
        self, name: str, read: Callable[[Any], Item], *path: str, params: Mapping[str, str] | None = None
    ) -> Steps[None]:
        """Emits the items of a list that comes in pages; each page has the whole timeout."""
        after: str | None = None
        while True:
            asked = {**(params or {}), **({} if after is None else {"after": after})}
            answer = yield from self.call("GET", *path, params=asked)
            items, after = answer.parsed(lambda data: ([read(one) for one in data[name]], data.get("next")))
            for item in items:
                yield Emit(item)
            if after is None:
                return
