"""Room for large answers: their bytes in memory, until callers have taken them in."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Annotated

from fastapi import Depends, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firstfix.errors import FirstfixError, Overloaded, QuotaExceeded

from ..http_server.streams import PIECE_BYTES, declared_bytes
from ..problems import problem_of
from ..telemetry.request_scope import current_caller
from .edge import needs_of

RETRY_AFTER_S = 2.0
SMALL_BYTES = 1 << 20
_ALL = "all"


class AnswerRoom:
    """Counts the bytes of large answers: of one caller, of one address, of all. Thread-safe.

    Whoever has none may always have one, however large it is.

    Args:
        limit_bytes: of all; one caller may have a quarter of it, and one address half. The last eighth is
            kept for answers below ``SMALL_BYTES``, such as metrics and lists.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._taken: Counter[str] = Counter()
        self._lock = threading.Lock()

    @property
    def taken_bytes(self) -> int:
        """Bytes of all large answers in memory."""
        return self._taken[_ALL]

    def take(self, caller: str, address: str, count: int) -> None:
        """Takes room for an answer.

        Raises:
            QuotaExceeded: the caller, or its address, has not taken in its other answers.
            Overloaded: nor have all callers together.
        """
        with self._lock:
            for name, part, what in ((caller, 4, "caller"), (_of(address), 2, "address")):
                if self._is_over(name, self._limit_bytes // part, count):
                    raise QuotaExceeded(
                        f"too many bytes wait for this {what} to read them: read the earlier answers first",
                        retry_after_s=RETRY_AFTER_S,
                    )
            kept_bytes = 0 if count < SMALL_BYTES else self._limit_bytes // 8
            if self._is_over(_ALL, self._limit_bytes - kept_bytes, count):
                raise Overloaded(
                    "too many bytes wait for callers to read them: try again", retry_after_s=RETRY_AFTER_S
                )
            for name in (caller, _of(address), _ALL):
                self._taken[name] += count

    def give_back(self, caller: str, address: str, count: int) -> None:
        """Gives back the room of an answer."""
        with self._lock:
            for name in (caller, _of(address), _ALL):
                self._taken[name] -= count
                if not self._taken[name]:
                    del self._taken[name]

    def _is_over(self, name: str, limit_bytes: int, count: int) -> bool:
        taken = self._taken[name]
        return taken > 0 and taken + count > limit_bytes


class AnswerPlace:
    """The room of one request's answer."""

    def __init__(self, room: AnswerRoom, scope: Scope) -> None:
        self._room = room
        self._scope = scope
        self._taken: list[tuple[str, str, int]] = []

    def take(self, size_bytes: int) -> None:
        """Takes room for a body of this size, before it is read into memory. Short bodies need none.

        Raises:
            QuotaExceeded, Overloaded: see ``AnswerRoom.take``.
        """
        missing = size_bytes - sum(count for _, _, count in self._taken)
        if size_bytes <= PIECE_BYTES or missing <= 0:
            return
        address, name = self._scope["state"]["address"], current_caller()
        name = name or f"stranger:{address}"
        self._room.take(name, address, missing)
        self._taken.append((name, address, missing))

    def give_back(self) -> None:
        """Gives the room back: the caller has taken the answer in, or has gone."""
        for taken in self._taken:
            self._room.give_back(*taken)
        self._taken.clear()


class CountedAnswers:
    """ASGI middleware that refuses a large answer while there is no room for it.

    A route that knows the size of its answer takes the room itself, before it reads the answer.
    """

    def __init__(self, app: ASGIApp, room: AnswerRoom) -> None:
        self._app = app
        self._room = room

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        place = AnswerPlace(self._room, scope)
        scope.setdefault("state", {})["answer_place"] = place
        is_refused = False

        async def send_if_there_is_room(message: Message) -> None:
            nonlocal is_refused
            if is_refused:
                return
            # public answers are in memory once, for all callers
            is_counted = scope["method"] != "HEAD" and needs_of(scope) is not None
            if message["type"] == "http.response.start" and is_counted:
                try:
                    place.take(declared_bytes(message["headers"]))
                except FirstfixError as error:
                    is_refused = True
                    await problem_of(error).response()(scope, receive, send)
                    return
            await send(message)

        try:
            await self._app(scope, receive, send_if_there_is_room)
        finally:
            place.give_back()


async def place_of(request: Request) -> AnswerPlace:
    """Dependency of routes: the room of the request's answer."""
    place: AnswerPlace = request.state.answer_place
    return place


AnswerPlaceDep = Annotated[AnswerPlace, Depends(place_of)]


def _of(address: str) -> str:
    """Name of an address among the names of callers, which may begin with ``address:`` themselves."""
    return f"from {address}"
