"""Waiting builds as streams of NATS JetStream.

    <NAME>_BUILDS          <name>.builds.waiting.<build_id>   work queue: one message per build, until acked
    <NAME>_DEAD_BUILDS     <name>.builds.dead.<build_id>      builds that used up their attempts, and why

A subject has one message at most, so a build can be submitted again without harm. The build, its status and
its attempts are in the store; a lost stream is made again from there.
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
MAX_AHEAD = (
    4  # builds in the stream that no build worker has asked for yet: their order cannot change any more
)
_SUBJECT_TAKEN = 10077  # JSStreamStoreFailedF: the subject has a message already
_OTHER_CONFIG = (
    10058  # JSStreamNameExistErr: the stream was made by another release, or changed by an operator
)
_DEAD_MAX_AGE_S = 90 * 86400.0
_DEAD_MAX_MESSAGES = 10_000


class NatsBuilds:
    """The streams of builds, over a connection that reconnects by itself. For use by one event loop.

    Args:
        lease_s: a message is delivered to another build worker if the first one is silent for so long.
        on_reconnect: called after the connection was lost and is back.

    Raises:
        InvalidOption: the address names a file that cannot be used.
    """

    def __init__(
        self, address: NatsAddress, *, lease_s: float, on_reconnect: Callable[[], None] = lambda: None
    ) -> None:
        self._url = address.url
        self._options = address.options()
        self._lease_s = lease_s
        self._on_reconnect = on_reconnect
        self._prefix = f"{address.name}.builds"
        self._stream = f"{address.name.upper()}_BUILDS"
        self._dead_stream = f"{address.name.upper()}_DEAD_BUILDS"
        self._client: Any = None
        self._jetstream: Any = None

    @property
    def connected(self) -> bool:
        """True if the connection is open now."""
        return self._client is not None and bool(self._client.is_connected)

    async def connect(self) -> None:
        """Connects; waits for the server as long as it takes."""
        import nats

        is_out = False

        async def failed(error: Exception) -> None:
            nonlocal is_out
            if not is_out:  # log once per outage, not at every try
                _log.warning("NATS does not answer", url=self._url, error=str(error) or type(error).__name__)
            is_out = True

        async def back() -> None:
            nonlocal is_out
            is_out = False
            _log.info("NATS answers again", url=self._url)
            self._on_reconnect()

        client = nats.NATS()
        await client.connect(
            self._url,
            name="firstfix",
            error_cb=failed,
            reconnected_cb=back,
            max_reconnect_attempts=-1,
            reconnect_time_wait=RECONNECT_S,
            ping_interval=10,
            **self._options,
        )
        _log.info("connected to NATS", url=self._url)
        is_out = False
        self._client = client
        self._jetstream = client.jetstream(timeout=API_TIMEOUT_S)

    async def close(self) -> None:
        """Close the connection, after a short try to send pending messages."""
        if self._client is None:
            return
        with suppress(Exception):
            await asyncio.wait_for(self._client.flush(), API_TIMEOUT_S)
        with suppress(Exception):
            await self._client.close()

    async def make_streams(self) -> None:
        """Make the streams and the consumer that do not exist.

        Raises:
            nats.errors.Error: the server does not answer, or refuses the request.
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
                max_deliver=-1,  # attempts are counted in the store, where an orderly stop is not a failure
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
            existing = await self._jetstream.stream_info(config.name)
            config.num_replicas = existing.config.num_replicas  # the operator may have set it
            await self._jetstream.update_stream(config)

    async def room(self) -> int:
        """How many builds should be submitted now.

        One for each build worker that waits, and ``MAX_AHEAD`` so that the next one need not wait.

        Raises:
            nats.errors.Error: the server does not answer, or refuses the request.
        """
        info = await self._jetstream.consumer_info(self._stream, CONSUMER)
        return MAX_AHEAD + (info.num_waiting or 0) - (info.num_pending or 0)

    async def submit(self, build_id: str) -> bool:
        """Put a build into the stream. Returns False if it is there already, waiting or running.

        Raises:
            nats.errors.Error: the server does not answer, or refuses the request.
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
        """Keep the id of a build that used up its attempts, with the reason, for operators.

        Raises:
            nats.errors.Error: the server does not answer, or refuses the request.
        """
        body = json.dumps({"build_id": build_id, "reason": reason[:1000]}).encode()
        await self._jetstream.publish(f"{self._prefix}.dead.{check_build_id(build_id)}", body)

    async def waiting(self) -> Any:
        """A pull subscription to the waiting builds.

        Raises:
            nats.errors.Error: the server does not answer, or refuses the request.
        """
        return await self._jetstream.pull_subscribe_bind(CONSUMER, self._stream)
