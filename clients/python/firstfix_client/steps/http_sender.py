"""Requests over HTTP as steps, with the route to the replicas and the policies."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from ..policies import HedgePolicy, RetryPolicy
from .deadline import Deadline
from .hedging import Hedging
from .http_messages import HttpAnswer, HttpRequest
from .send import send
from .step import Emit, Steps

Item = TypeVar("Item")


class HttpRoute:
    """URLs of the service's replicas. One, picked at random, is asked until it fails."""

    def __init__(self, urls: Sequence[str]) -> None:
        self._urls = list(urls)
        random.shuffle(self._urls)  # robots with the same list spread over the replicas
        self._lock = threading.Lock()

    def order(self) -> list[str]:
        """Returns all URLs, the one that answered last first."""
        with self._lock:
            return list(self._urls)

    def rival(self, target: str, others: list[str]) -> str | None:
        """Returns the next URL; or the only one, since many replicas may stand behind it."""
        if others:
            return others[0]
        return target if len(self._urls) == 1 else None

    def last_resort(self, target: str, others: list[str]) -> str | None:
        """Returns None: a broken connection is noticed."""
        return None

    def answered(self, target: str) -> None:
        """Puts this URL first."""
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
        """Sends a request to the service, see ``send.send``."""
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
        """Sends a request that does not depend on the time left."""
        return self.send(lambda left_s: request, deadline, **how)

    def call(
        self,
        method: str,
        *path: str,
        params: Mapping[str, str] | None = None,
        json: Any = None,
        repeatable: bool = True,
    ) -> Steps[HttpAnswer]:
        """Sends a request without a body, or with a short JSON body."""
        request = HttpRequest(method, path, params=params or {}, json=json)
        return self.send_same(request, repeatable=repeatable)

    def pages(
        self, name: str, read: Callable[[Any], Item], *path: str, params: Mapping[str, str] | None = None
    ) -> Steps[None]:
        """Emits the items of a paged list. Each page has the whole timeout."""
        after: str | None = None
        while True:
            asked = {**(params or {}), **({} if after is None else {"after": after})}
            answer = yield from self.call("GET", *path, params=asked)
            items, after = answer.parsed(lambda data: ([read(one) for one in data[name]], data.get("next")))
            for item in items:
                yield Emit(item)
            if after is None:
                return
