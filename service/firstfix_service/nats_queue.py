"""The service's side of the builds in NATS: hands them over, now or once NATS can be reached."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import structlog

from firstfix.catalog import Catalog
from firstfix.errors import FirstfixError

from .lanes import UPKEEP
from .metrics import Metrics
from .nats_address import NatsAddress
from .nats_builds import NatsBuilds
from .settings import Settings
from .unfinished_builds import UnfinishedBuilds

_log = structlog.get_logger(__name__)
RECONCILE_S = 15.0
RETRY_S = 2.0


class NatsBuildQueue:
    """A ``BuildQueue`` whose builds ``firstfix worker`` runs, anywhere. One event loop's.

    Every so often what is on record, not ended and not in the stream is submitted (again): builds that
    were posted while NATS was out of reach, or a stream that was lost. Any number of processes do so.

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

    async def submit(self, build_id: str) -> None:
        from nats.errors import Error

        try:
            if self.builds.connected:
                await self.builds.submit(build_id)
                return
        except Error as error:
            _log.warning("build is on record and waits for NATS", build_id=build_id, error=str(error))
        self._wake.set()

    async def run(self) -> None:
        from nats.errors import Error

        try:
            await self.builds.connect()
            while True:
                self._wake.clear()
                pause_s = RECONCILE_S
                try:
                    await self._reconcile()
                except Error as error:
                    _log.warning("builds on record wait for NATS", error=str(error))
                    pause_s = RETRY_S
                except FirstfixError as error:
                    _log.warning("builds on record cannot be read", code=error.code, error=str(error))
                except Exception:  # one odd build must not end the queue
                    _log.exception("the build queue stumbled")
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._wake.wait(), pause_s)
        finally:
            await self.builds.close()

    async def _reconcile(self) -> None:
        await self.builds.make_streams()
        for build_id in await UPKEEP.run(self._unfinished.find):
            if await self.builds.submit(build_id):
                _log.info("build handed over", build_id=build_id)
