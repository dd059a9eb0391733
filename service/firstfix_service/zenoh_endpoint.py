"""The same use case over zenoh.

    firstfix/{map_id}/localize             one queryable for every map this replica can serve (complete)
    firstfix/{map_id}/localize/{replica}   this replica alone; a liveliness token for each map

The options are selector parameters, the payload the same bytes as the HTTP body, its encoding the media
type. The parameters ``content_encoding`` and ``accept`` stand for HTTP's headers. Errors are replied as
the same problem documents.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections import Counter
from collections.abc import Iterable
from concurrent import futures
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import structlog
import zenoh

from firstfix.errors import FirstfixError, InvalidOption, TooLarge
from firstfix.ids import check_map_id
from firstfix.localization import Localization

from . import problems
from .localize import LocalizeUseCase
from .pool import QueryPool
from .pose_reply import PoseReply, form_of
from .problems import problem_of
from .settings import Settings

_log = structlog.get_logger(__name__)
CONTENT_ENCODING = "content_encoding"
ACCEPT = "accept"
TRANSPORT = "zenoh"
DRAIN_S = 10.0  # for queries under way when the service stops


@dataclass(frozen=True)
class _Asked:
    """A query as it came."""

    map_id: str
    media_type: str
    content_encoding: str | None
    options: dict[str, str]
    pose: PoseReply | None


class ZenohEndpoint:
    """Opens a session and answers in it until it is closed."""

    def __init__(
        self,
        settings: Settings,
        replica: str,
        use_case: LocalizeUseCase,
        pool: QueryPool,
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        """Blocks until the session is open.

        Raises:
            InvalidOption: the config cannot be used, or an endpoint cannot be had.
        """
        self.replica = replica
        self._use_case = use_case
        self._pool = pool
        self._loop = loop
        self._max_body_bytes = settings.max_body_bytes
        self._tokens: dict[str, Any] = {}
        self._tokens_lock = threading.Lock()
        self._closed = False
        self._pending: set[Future[None]] = set()
        try:
            self._session = zenoh.open(session_config(settings))
        except zenoh.ZError as error:
            raise InvalidOption(f"zenoh: {error}") from None
        self._queryables = [
            self._session.declare_queryable(key, self._on_query, complete=True)
            for key in ("firstfix/*/localize", f"firstfix/*/localize/{replica}")
        ]

    def show_maps(self, map_ids: Iterable[str]) -> None:
        """Keeps one liveliness token a map. Thread-safe."""
        wanted = set(map_ids)
        with self._tokens_lock:
            if self._closed:
                return
            for map_id in wanted - self._tokens.keys():
                key = f"firstfix/{map_id}/localize/{self.replica}"
                self._tokens[map_id] = self._session.liveliness().declare_token(key)
            for map_id in self._tokens.keys() - wanted:
                self._tokens.pop(map_id).undeclare()

    def close(self) -> None:
        """Takes the tokens and keys back first, so that nobody new comes; answers who is there; closes."""
        with self._tokens_lock:
            self._closed = True
            for token in self._tokens.values():
                token.undeclare()
            self._tokens.clear()
        for queryable in self._queryables:
            queryable.undeclare()
        futures.wait(self._pending.copy(), timeout=DRAIN_S)
        self._session.close()

    def _on_query(self, query: Any) -> None:
        """zenoh's callbacks come one after the other: nothing is done here but to hand over."""
        arrived = time.monotonic()
        try:
            self._pool.check_room()
        except FirstfixError as error:  # before its payload is copied
            self._use_case.count(TRANSPORT, error)
            with query:
                _reply_error(query, error)
            return
        try:
            future = asyncio.run_coroutine_threadsafe(self._answer(query, arrived), self._loop)
        except RuntimeError:  # the loop has ended with the service
            query.drop()
            return
        self._pending.add(future)
        future.add_done_callback(self._pending.discard)
        future.add_done_callback(_log_defect)

    async def _answer(self, query: Any, arrived: float) -> None:
        with query:
            try:
                asked = read_query(query)
                answer, (content, form) = await self._localize(query, asked, arrived)
            except Exception as error:
                if not isinstance(error, FirstfixError):
                    _log.exception("unexpected error", key=str(query.key_expr))
                self._use_case.count(TRANSPORT, error)
                _reply_error(query, error)
                return
            self._use_case.count(TRANSPORT, answer)
            # The key has to be one that the query's own covers: it may ask for every replica.
            key = f"firstfix/{asked.map_id}/localize"
            own = f"{key}/{self.replica}"
            to_this_replica = query.key_expr.intersects(zenoh.KeyExpr(own))
            query.reply(own if to_this_replica else key, content, encoding=form)

    async def _localize(
        self, query: Any, asked: _Asked, arrived: float
    ) -> tuple[Localization, tuple[bytes, str]]:
        payload = query.payload  # None: an empty body, as over HTTP
        size = 0 if payload is None else len(payload)
        if size > self._max_body_bytes:
            raise TooLarge(f"the body has {size} bytes, the limit is {self._max_body_bytes}")
        body = b"" if payload is None else payload.to_bytes()
        answer = await self._use_case.localize(
            body, asked.media_type, asked.content_encoding, asked.map_id, asked.options, arrived=arrived
        )
        return answer, form_of(answer, asked.pose, body, asked.media_type, asked.content_encoding)


def read_query(query: Any) -> _Asked:
    """
    Raises:
        InvalidOption: its key names no single map, a parameter stands twice, or one of the reply's form
            cannot be used.
    """
    parts = str(query.key_expr).split("/")
    map_id = check_map_id(parts[1] if len(parts) > 1 else "")
    pairs = list(query.parameters)
    twice = sorted(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
    if twice:
        raise InvalidOption(f"given more than once: {', '.join(twice)}")
    # Names that begin with an underscore are zenoh's own.
    options = {name: value for name, value in pairs if not name.startswith("_")}
    content_encoding = options.pop(CONTENT_ENCODING, None)
    pose = PoseReply.wanted(options.pop(ACCEPT, ""), options)
    media_type = "" if query.encoding is None else str(query.encoding)
    return _Asked(map_id, media_type, content_encoding, options, pose)


def session_config(settings: Settings) -> Any:
    """The operator's file as it is, else a peer on the given endpoints that looks for nobody.

    Raises:
        InvalidOption: the file cannot be read.
    """
    try:
        if settings.zenoh_config is not None:
            config = zenoh.Config.from_file(str(settings.zenoh_config))
        else:
            config = zenoh.Config()
            config.insert_json5("mode", '"peer"')
            config.insert_json5("listen/endpoints", json.dumps(settings.zenoh_listen))
            config.insert_json5("connect/endpoints", json.dumps(settings.zenoh_connect))
            config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/link/rx/max_message_size", str(settings.zenoh_max_message_bytes))
    except zenoh.ZError as error:
        raise InvalidOption(f"zenoh config: {error}") from None
    return config


def _reply_error(query: Any, error: BaseException) -> None:
    query.reply_err(problem_of(error).body, encoding=problems.MEDIA_TYPE)


def _log_defect(future: Future[None]) -> None:
    """A reply that could not be sent: the session is closing, or the asker has gone."""
    if not future.cancelled() and (error := future.exception()) is not None:
        _log.warning("no reply could be sent", error=repr(error))
