"""Sends events to the operator's URLs, in a thread of its own with its own event loop.

No query waits for it or fails because of it. What waits is bounded in number, bytes, attempts and time; an
event for which there is no room is dropped and counted.
"""

from __future__ import annotations

import asyncio
import random
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import structlog

from firstfix.errors import InvalidOption

from ..settings import Settings
from ..telemetry.metrics import Metrics
from .event import AnswerEvent, read_secrets, signed_headers

if TYPE_CHECKING:
    import httpx

_log = structlog.get_logger(__name__)
MAX_WAITING, MAX_WAITING_BYTES = 1000, 32 << 20  # for one URL, those that are tried again too
AT_ONCE = 4  # requests to one URL
TIMEOUT_S = 10.0  # for one attempt, from the name's look-up to the answer's head
MAX_ATTEMPTS, FIRST_WAIT_S, MAX_WAIT_S = 10, 1.0, 120.0  # the wait doubles
MAX_AGE_S = 900.0  # afterwards an event is of no use
STOP_WITHIN_S = 3.0  # for what is under way when the service stops
MAX_BODY_BYTES = 1 << 20
GONE = 410  # the receiver wants no more, as Standard Webhooks has it
_FINAL = ("redirect", "gone")  # redirects are not followed: they could lead anywhere


@dataclass(frozen=True)
class WebhookPolicy:
    """Receivers, and the events that each gets.

    Attributes:
        secrets: that sign them.
        verdicts: that are sent.
    """

    urls: tuple[str, ...]
    secrets: tuple[bytes, ...]
    verdicts: frozenset[str]

    @classmethod
    def of(cls, settings: Settings) -> WebhookPolicy | None:
        """The policy in the settings; None: no webhooks.

        Raises:
            InvalidOption: a URL or the secrets cannot be used.
        """
        urls = tuple(url.get_secret_value() for url in settings.webhook_urls)
        if not urls:
            return None
        for number, url in enumerate(urls, 1):
            _check_url(url, number)
        if settings.webhook_secret_file is None:
            raise InvalidOption(
                "FIRSTFIX_WEBHOOK_URLS needs FIRSTFIX_WEBHOOK_SECRET_FILE, which signs events"
            )
        return cls(urls, read_secrets(settings.webhook_secret_file), frozenset(settings.webhook_verdicts))


def _check_url(url: str, number: int) -> None:
    """Check a URL. A message does not show it: its path may be a secret."""
    try:
        import httpx  # imported late: most services have no webhooks

        parts = urlsplit(url)
        valid = parts.scheme in ("http", "https") and bool(parts.hostname) and "@" not in parts.netloc
        httpx.URL(url)
    except (ValueError, httpx.InvalidURL):
        valid = False
    if not valid or parts.fragment:
        raise InvalidOption(
            f"FIRSTFIX_WEBHOOK_URLS: URL number {number} is not http or https, with a host and without a user"
        )


class _Receiver:
    """One URL, and what waits for it."""

    def __init__(self, url: str) -> None:
        self.url, self.host = url, urlsplit(url).hostname
        self.waiting, self.waiting_bytes = 0, 0
        self.fails = False
        self.slots = asyncio.Semaphore(AT_ONCE)


class WebhookSender:
    """Sends events. ``offer`` is for any thread."""

    def __init__(self, policy: WebhookPolicy, metrics: Metrics) -> None:
        self._policy, self._metrics = policy, metrics
        self._receivers = [_Receiver(url) for url in policy.urls]
        self._lock = threading.Lock()  # of the receivers' counts
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._closed = False
        self._client: httpx.AsyncClient | None = None
        self._thread = threading.Thread(target=self._run, name="webhooks", daemon=True)
        metrics.webhook_waiting.set_function(lambda: sum(one.waiting for one in self._receivers))

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """End the thread. Requests under way have ``STOP_WITHIN_S``; what waits is dropped and counted."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2 * STOP_WITHIN_S)

    def offer(self, event: AnswerEvent) -> None:
        """Send an event if its verdict is wanted and there is room. Never blocks and never fails."""
        if event.answer.verdict.value not in self._policy.verdicts:
            return
        body = event.body()
        for receiver in self._receivers:
            if not self._admit(receiver, len(body)):
                self._count("dropped")
                continue
            try:
                self._loop.call_soon_threadsafe(self._begin, receiver, event.event_id, body)
            except RuntimeError:  # closed just now
                self._count("dropped")

    def _admit(self, receiver: _Receiver, size: int) -> bool:
        with self._lock:
            room = receiver.waiting < MAX_WAITING and receiver.waiting_bytes + size <= MAX_WAITING_BYTES
            if self._closed or not room or size > MAX_BODY_BYTES:
                return False
            receiver.waiting += 1
            receiver.waiting_bytes += size
        return True

    def _count(self, result: str) -> None:
        self._metrics.webhook_events.labels(result).inc()

    def _run(self) -> None:
        import httpx

        asyncio.set_event_loop(self._loop)
        try:
            self._client = httpx.AsyncClient(timeout=TIMEOUT_S, follow_redirects=False)
            self._loop.run_forever()
            self._loop.run_until_complete(self._finish(self._client))
        except Exception:  # a defect ends the webhooks, and not the service
            _log.exception("webhooks ended")
        finally:
            self._loop.close()

    async def _finish(self, client: httpx.AsyncClient) -> None:
        tasks = set(self._tasks)
        if tasks:
            _, late = await asyncio.wait(tasks, timeout=STOP_WITHIN_S)
            _log.info("webhooks stop", dropped=len(late))
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await client.aclose()

    def _begin(self, receiver: _Receiver, event_id: str, body: bytes) -> None:
        task = self._loop.create_task(self._deliver(receiver, event_id, body))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _deliver(self, receiver: _Receiver, event_id: str, body: bytes) -> None:
        result = "dropped"
        try:
            result = await self._attempts(receiver, event_id, body)
        except Exception:
            result = "failed"
            _log.exception("an event was not sent", host=receiver.host)
        finally:
            self._count(result)
            with self._lock:
                receiver.waiting -= 1
                receiver.waiting_bytes -= len(body)

    async def _attempts(self, receiver: _Receiver, event_id: str, body: bytes) -> str:
        """The result: a label of the metric."""
        began = time.monotonic()
        for number in range(MAX_ATTEMPTS):
            if number:
                if self._closed:
                    return "dropped"
                wait_s = min(FIRST_WAIT_S * 2.0 ** (number - 1), MAX_WAIT_S)
                await asyncio.sleep(wait_s * random.uniform(0.5, 1.0))
            async with receiver.slots:
                if time.monotonic() - began > MAX_AGE_S:
                    break
                problem = await self._post(receiver, event_id, body)
            self._tell(receiver, problem)
            if not problem:
                return "sent"
            if problem in _FINAL or number + 1 == MAX_ATTEMPTS:
                break
            self._metrics.webhook_retries.inc()
        return "failed"

    async def _post(self, receiver: _Receiver, event_id: str, body: bytes) -> str:
        """Make one attempt. Returns what went wrong; empty: nothing."""
        import httpx

        assert self._client is not None
        headers = signed_headers(event_id, body, self._policy.secrets, int(time.time()))
        try:
            return await asyncio.wait_for(self._status(receiver.url, headers, body), TIMEOUT_S)
        except (TimeoutError, asyncio.TimeoutError):
            return "timeout"
        except (httpx.HTTPError, OSError) as error:
            return type(error).__name__

    async def _status(self, url: str, headers: dict[str, str], body: bytes) -> str:
        assert self._client is not None
        async with self._client.stream("POST", url, content=body, headers=headers) as answer:
            if answer.is_success:  # its body is not read
                return ""
            if answer.has_redirect_location or 300 <= answer.status_code < 400:
                return "redirect"
            return "gone" if answer.status_code == GONE else f"status {answer.status_code}"

    def _tell(self, receiver: _Receiver, problem: str) -> None:
        if bool(problem) != receiver.fails:
            receiver.fails = bool(problem)
            if problem:
                _log.warning("a receiver of webhooks fails", host=receiver.host, problem=problem)
            else:
                _log.info("a receiver of webhooks works again", host=receiver.host)
