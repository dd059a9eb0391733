"""Workers that answer queries: threads of this process, or processes (``query_workers.processes``)."""

from __future__ import annotations

import asyncio
import contextvars
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

from firstfix.engine.deadline import Deadline
from firstfix.engine.localizer import Localizer

from .localizers import Localizers
from .look import Answered, Asked
from .query import ServedVersion
from .sightings.counter import Sighted, SightingCounter

MAX_BODY_BYTES = 64 << 20


class QueryWorkerDied(Exception):
    """The process ended, or was killed because it did not answer."""


class QueryWorker(Protocol):
    """One worker, for one query at a time."""

    @property
    def is_alive(self) -> bool:
        """False if it takes no more queries."""

    def answer(self, asked: Asked) -> asyncio.Future[Answered]:
        """The answer to a query, whose versions are loaded if they are not, or to a look.

        The future raises:
            QueryWorkerDied: it ended before it answered.
            DeadlineExceeded: the query took too long. The worker ends.
            InputError: the body or an option cannot be used.
            VersionError: a version cannot be loaded.
            QueryCancelled: as ``cancel``.
        """

    def cancel(self, answer: asyncio.Future[Answered]) -> None:
        """Let the query of an answer, for which nobody waits any more, end at once.

        The answer then fails with QueryCancelled, unless it comes all the same. Until then the worker is not
        free.
        """


class QueryWorkers(Protocol):
    """Workers that answer queries, and the versions in all of them. Thread-safe.

    Each worker is given to the ``QueryGate`` when it is up.
    """

    def load(self, version: ServedVersion) -> int:
        """Load a version in every worker. Blocks.

        Returns:
            Bytes of memory of all workers together, without the mapped files.

        Raises:
            VersionError: the version cannot be loaded.
        """
        ...

    def warm_up(self, version: ServedVersion) -> int:
        """Ask a loaded version about scans of its own map, once in every worker. Blocks.

        Returns:
            The number of these queries.

        Raises:
            Exception: of any kind; the version can be asked all the same.
        """
        ...

    def drop(self, version: ServedVersion) -> None:
        """Unload a version that no query uses. Blocks."""
        ...

    def take_sightings(self) -> list[Sighted]:
        """The sightings that were counted since the last call. Blocks."""
        ...

    def close(self) -> None:
        """End the workers. Blocks. Call it when no query runs."""
        ...


class QueryWorkerThreads:
    """Workers without processes.

    Args:
        load: makes the localizer of a version's folder.
        count: queries that are answered at the same time.
        on_up: called with each worker.
        max_body_bytes: largest body of a query, with and without its content encoding.
        counts_sightings: of localized queries.
    """

    is_alive = True

    def __init__(
        self,
        load: Callable[[Path], Localizer],
        count: int = 1,
        *,
        on_up: Callable[[QueryWorker], None] = lambda worker: None,
        max_body_bytes: int = MAX_BODY_BYTES,
        counts_sightings: bool = False,
    ) -> None:
        self._sightings = SightingCounter() if counts_sightings else None
        self._localizers = Localizers(load, max_body_bytes, self._sightings)
        self._deadlines: dict[asyncio.Future[Answered], Deadline] = {}  # of the queries under way
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="query")
        for _ in range(count):
            on_up(self)

    @property
    def loaded(self) -> tuple[ServedVersion, ...]:
        """The versions in memory, in the order in which they were loaded."""
        return self._localizers.loaded

    def load(self, version: ServedVersion) -> int:
        """Load a version; returns its bytes in memory."""
        return self._localizers.load(version)

    def warm_up(self, version: ServedVersion) -> int:
        """Ask a version about scans of its own map; returns their number."""
        return self._localizers.warm_up(version)

    def drop(self, version: ServedVersion) -> None:
        """Unload a version."""
        self._localizers.drop(version)

    def answer(self, asked: Asked) -> asyncio.Future[Answered]:
        """The answer to a query or a look."""
        context = contextvars.copy_context()  # for what is logged on the way
        loop = asyncio.get_running_loop()
        deadline = Deadline(asked.deadline)
        answer = loop.run_in_executor(self._threads, context.run, self._localizers.answer, asked, deadline)
        self._deadlines[answer] = deadline
        answer.add_done_callback(self._deadlines.pop)
        if (sightings := self._sightings) is not None:
            answer.add_done_callback(lambda _: sightings.wake())
        return answer

    def cancel(self, answer: asyncio.Future[Answered]) -> None:
        """Let the query of an answer end."""
        if answer in self._deadlines:
            self._deadlines[answer].cancel()

    def take_sightings(self) -> list[Sighted]:
        """The sightings that were counted since the last call."""
        return [] if self._sightings is None else [self._sightings.take()]

    def close(self) -> None:
        """Unload all versions."""
        self._threads.shutdown()
        if self._sightings is not None:
            self._sightings.close()
        self._localizers.clear()
