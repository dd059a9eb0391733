"""The service's side of the builds in NATS: hands them over, now or once NATS can be reached.

The stream gives builds out in the order in which they came. So it is kept short, and callers take turns at
what comes into it: builds that have to wait do so in the store.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError

from ...lanes import UPKEEP
from ...settings import Settings
from ...telemetry.metrics import Metrics
from ..fair_order import FairOrder
from ..unfinished import UnfinishedBuilds
from .address import NatsAddress
from .builds import NatsBuilds

_log = structlog.get_logger(__name__)
RECONCILE_S = 15.0
ROOM_S = 1.0  # between looks for room in the stream, while builds wait for some
RETRY_S = 2.0


class NatsBuildQueue:
    """A ``BuildQueue`` whose builds ``firstfix worker`` runs, anywhere. One event loop's.

    Every so often what is on record, not ended and not in the stream is submitted (again), as far as there
    is room: new builds, those that were posted while NATS was out of reach, or a stream that was lost. Any
    number of processes do so.

    Raises:
        InvalidOption: the settings name no NATS server, or a file that cannot be used.
    """

    running: str | None = None  # never in this process

    def __init__(self, settings: Settings, catalog: Catalog, metrics: Metrics) -> None:
        self._wake = asyncio.Event()
        self.builds = NatsBuilds(
            NatsAddress.of(settings), lease_s=settings.build_lease_s, when_back=self._wake.set
        )
        self._unfinished = UnfinishedBuilds(catalog, metrics)
        self._order = FairOrder()

    async def submit(self, build_id: str) -> None:
        self._wake.set()

    async def run(self) -> None:
        from nats.errors import Error

        try:
            await self.builds.connect()
            waits, looked_at = False, 0.0
            while True:
                self._wake.clear()
                pause_s = RECONCILE_S
                try:
                    await self.builds.make_streams()
                    room = await self.builds.room()
                    if not waits or room > 0 or time.monotonic() > looked_at + RECONCILE_S:
                        looked_at = time.monotonic()
                        waits = await self._hand_over(room)
                    if waits:
                        pause_s = ROOM_S
                except Error as error:
                    _log.warning("builds on record wait for NATS", error=str(error))
                    pause_s = RETRY_S
                except FirstfixError as error:
                    _log.warning("builds on record cannot be read", code=error.code, error=str(error))
                except Exception:  # one odd build must not end the queue
                    _log.exception("the build queue stumbled")
                with suppress(TimeoutError):
                    async with asyncio.timeout(pause_s):
                        await self._wake.wait()
        finally:
            await self.builds.close()

    async def _hand_over(self, room: int) -> bool:
        """Submits up to so many builds that are not in the stream. Whether others have to wait."""
        for build in self._order.of(await UPKEEP.run(self._unfinished.find)):
            if room <= 0:
                return True
            if await self.builds.submit(build.build_id):
                room -= 1
                self._order.served(build.owner)
                _log.info("build handed over", build_id=build.build_id)
        return False
