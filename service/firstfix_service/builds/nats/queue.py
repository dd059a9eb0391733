"""Build queue of a service with NATS: submits builds to the stream as soon as NATS answers.

The stream delivers builds in the order of their submission. So it is kept short, owners take turns at it, and
the other builds wait in the store.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError

from ...settings import Settings
from ...telemetry.metrics import Metrics
from ...thread_pools import MAINTENANCE
from ...thread_pools.background import end_if_cancelled
from ..queue import FairOrder, UnfinishedBuilds
from .address import NatsAddress
from .builds import NatsBuilds

_log = structlog.get_logger(__name__)
RECONCILE_S = 15.0  # between reads of the builds on record
ROOM_S = 1.0  # between checks for room in the stream, while builds wait for it
RETRY_S = 2.0


class NatsBuildQueue:
    """A ``BuildQueue`` whose builds run on build workers (``firstfix worker``). For use by one event loop.

    It regularly submits the unfinished builds that are not in the stream, as far as there is room: new
    builds, builds posted while NATS did not answer, and all of them after the stream was lost. Any number of
    processes may do so.

    Raises:
        InvalidOption: the settings name no NATS server, or a file that cannot be used.
    """

    running: str | None = None  # no build runs in this process

    def __init__(self, settings: Settings, catalog: Catalog, metrics: Metrics) -> None:
        self._wake = asyncio.Event()
        self.builds = NatsBuilds(
            NatsAddress.of(settings), lease_s=settings.build_lease_s, on_reconnect=self._wake.set
        )
        self._unfinished = UnfinishedBuilds(catalog, metrics)
        self._order = FairOrder()

    @property
    def waits_for(self) -> str | None:
        """Why no build begins; None: build workers take them in turn."""
        return None if self.builds.connected else "NATS does not answer"

    async def submit(self, build_id: str) -> None:
        """Wake the queue."""
        self._wake.set()

    async def run(self) -> None:
        """Submit builds until it is cancelled."""
        from nats.errors import Error

        try:
            await self.builds.connect()
            waiting, read_at = False, 0.0
            while True:
                end_if_cancelled()
                self._wake.clear()
                pause_s = RECONCILE_S
                try:
                    await self.builds.make_streams()
                    room = await self.builds.room()
                    if not waiting or room > 0 or time.monotonic() > read_at + RECONCILE_S:
                        read_at = time.monotonic()
                        waiting = await self._submit_waiting(room)
                    if waiting:
                        pause_s = ROOM_S
                except Error as error:
                    _log.warning("builds on record wait for NATS", error=str(error))
                    pause_s = RETRY_S
                except FirstfixError as error:
                    _log.warning("builds on record cannot be read", code=error.code, error=str(error))
                except Exception:  # a defect at one build must not end the queue
                    _log.exception("the build queue failed")
                with suppress(TimeoutError):
                    async with asyncio.timeout(pause_s):
                        await self._wake.wait()
        finally:
            await self.builds.close()

    async def _submit_waiting(self, room: int) -> bool:
        """Submit up to ``room`` builds that are not in the stream. Returns whether others have to wait."""
        for build in self._order.sort(await MAINTENANCE.run(self._unfinished.find)):
            if room <= 0:
                return True
            if await self.builds.submit(build.build_id):
                room -= 1
                self._order.had_turn(build.owner)
                _log.info("build submitted to NATS", build_id=build.build_id)
        return False
