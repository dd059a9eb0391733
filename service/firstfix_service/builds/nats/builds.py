"""The builds that wait, as streams of NATS JetStream.

    <NAME>_BUILDS          <name>.builds.waiting.<build_id>   work queue: one message a build, gone when acked
    <NAME>_DEAD_BUILDS     <name>.builds.dead.<build_id>      the last word on builds that had their attempts

One message a subject, and no second one while it is there: so a build can be submitted as often as one
likes. The build itself, its status and its attempts are in the store; a stream that is lost is made again
from there.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import structlog

from firstfix.ids import check_build_id

from .address import NatsAddress

_log = structlog.get_logger(__name__)
API_TIMEOUT_S = 3.0
RECONNECT_S = 1
CONSUMER = "workers"
AHEAD = 4  # builds in the stream that no worker has asked for yet: their order is settled
_SUBJECT_TAKEN = 10077  # JSStreamStoreFailedF: the subject has its one message
_OTHER_CONFIG = 10058  # JSStreamNameExistErr: a stream of another release, or edited by an operator
_DEAD_MAX_AGE_S = 90 * 86400.0
_DEAD_MAX_MESSAGES = 10_000


class NatsBuilds:
    """A connection that comes back by itself, and the streams. One event loop's.

    Args:
        lease_s: without a sign of life from a worker until a message is given to another one.
        when_back: called after the connection was lost and is there again.

    Raises:
        InvalidOption: the address names a file that cannot be used.
    """

    def __init__(
        self, address: NatsAddress, *, lease_s: float, when_back: Callable[[], None] = lambda: None
    ) -> None:
        self._url = address.url
        self._options = address.options()
        self._lease_s = lease_s
        self._when_back = when_back
        self._prefix = f"{address.name}.builds"
        self._stream = f"{address.name.upper()}_BUILDS"
        self._dead_stream = f"{address.name.upper()}_DEAD_BUILDS"
        self._client: Any = None
        self._jetstream: Any = None

    @property
    def connected(self) -> bool:
        return self._client is not None and bool(self._client.is_connected)

    async def connect(self) -> None:
        """Returns once the server is there, however long that takes."""
        import nats

        out = False

        async def told(error: Exception) -> None:
            nonlocal out
            if not out:  # once an outage, not at every try
                _log.warning("NATS is out of reach", url=self._url, error=str(error) or type(error).__name__)
            out = True

        async def back() -> None:
            nonlocal out
            out = False
            _log.info("NATS is back", url=self._url)
            self._when_back()

        client = nats.NATS()
        await client.connect(
            self._url,
            name="firstfix",
            error_cb=told,
            reconnected_cb=back,
            max_reconnect_attempts=-1,
            reconnect_time_wait=RECONNECT_S,
            ping_interval=10,
            **self._options,
        )
        _log.info("connected to NATS", url=self._url)
        out = False
        self._client = client
        self._jetstream = client.jetstream(timeout=API_TIMEOUT_S)

    async def close(self) -> None:
        """Sends what is on its way, as far as the server takes it."""
        if self._client is None:
            return
        with suppress(Exception):
            await asyncio.wait_for(self._client.flush(), API_TIMEOUT_S)
        with suppress(Exception):
            await self._client.close()

    async def make_streams(self) -> None:
        """Makes what is not there.

        Raises:
            nats.errors.Error: the server does not answer, or refuses.
        """
        from nats.js import api

        await self._make_stream(
            api.StreamConfig(
                name=self._stream,
                subjects=[f"{self._prefix}.waiting.*"],
                retention=api.RetentionPolicy.WORK_QUEUE,
                storage=api.StorageType.FILE,
                max_msgs_per_subject=1,
                discard=api.DiscardPolicy.NEW,
                discard_new_per_subject=True,
                max_msg_size=4096,
                duplicate_window=10.0,
            )
        )
        await self._make_stream(
            api.StreamConfig(
                name=self._dead_stream,
                subjects=[f"{self._prefix}.dead.*"],
                storage=api.StorageType.FILE,
                max_msgs_per_subject=1,
                max_msgs=_DEAD_MAX_MESSAGES,
                max_age=_DEAD_MAX_AGE_S,
                max_msg_size=4096,
            )
        )
        await self._jetstream.add_consumer(
            self._stream,
            api.ConsumerConfig(
                durable_name=CONSUMER,
                ack_policy=api.AckPolicy.EXPLICIT,
                ack_wait=self._lease_s,
                max_deliver=-1,  # what counts is in the store: a stop in good order is no failure
                max_ack_pending=1000,
                filter_subject=f"{self._prefix}.waiting.*",
            ),
        )

    async def _make_stream(self, config: Any) -> None:
        from nats.js.errors import APIError

        try:
            await self._jetstream.add_stream(config)
        except APIError as error:
            if error.err_code != _OTHER_CONFIG:
                raise
            there = await self._jetstream.stream_info(config.name)
            config.num_replicas = there.config.num_replicas  # the operator's
            await self._jetstream.update_stream(config)

    async def room(self) -> int:
        """Number of builds that can be submitted before the stream is further ahead of the workers than it
        has to be: one for each worker that waits, and a few so that none has to.

        Raises:
            nats.errors.Error: the server does not answer, or refuses.
        """
        told = await self._jetstream.consumer_info(self._stream, CONSUMER)
        return AHEAD + (told.num_waiting or 0) - (told.num_pending or 0)

    async def submit(self, build_id: str) -> bool:
        """False when the build waits in the stream already, or is being run.

        Raises:
            nats.errors.Error: the server does not answer, or refuses.
        """
        from nats.js.errors import APIError

        try:
            ack = await self._jetstream.publish(
                f"{self._prefix}.waiting.{check_build_id(build_id)}",
                build_id.encode(),
                headers={"Nats-Msg-Id": build_id},
            )
        except APIError as error:
            if error.err_code == _SUBJECT_TAKEN:
                return False
            raise
        return not ack.duplicate

    async def bury(self, build_id: str, reason: str) -> None:
        """Keeps the id of a build that had its attempts, with the reason: for people and their tools.

        Raises:
            nats.errors.Error: the server does not answer, or refuses.
        """
        body = json.dumps({"build_id": build_id, "reason": reason[:1000]}).encode()
        await self._jetstream.publish(f"{self._prefix}.dead.{check_build_id(build_id)}", body)

    async def waiting(self) -> Any:
        """A pull subscription to the builds that wait.

        Raises:
            nats.errors.Error: the server does not answer, or refuses.
        """
        return await self._jetstream.pull_subscribe_bind(CONSUMER, self._stream)
