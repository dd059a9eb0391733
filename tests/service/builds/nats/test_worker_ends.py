"""A cancellation ends the build worker and the queue, even if a library dropped it."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from nats.errors import TimeoutError as NothingWaits

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_service.builds.nats.queue import NatsBuildQueue
from firstfix_service.builds.worker import BuildWorker
from firstfix_service.settings import Settings
from firstfix_service.telemetry.metrics import Metrics
from tests.waiting import LIMIT_S


class DroppingBuilds:
    """Stands for the stream. The first call drops a cancellation, as ``asyncio.wait_for`` may."""

    connected = True

    def __init__(self) -> None:
        self.called, self.calls = asyncio.Event(), 0

    async def _drop(self) -> None:
        self.calls += 1
        self.called.set()
        if self.calls == 1:
            with suppress(asyncio.CancelledError):
                await asyncio.Event().wait()
        else:
            await asyncio.sleep(0)

    async def connect(self) -> None: ...

    async def close(self) -> None: ...

    async def make_streams(self) -> None: ...

    async def waiting(self) -> DroppingBuilds:
        return self

    async def fetch(self, count: int, timeout: float) -> list[Any]:
        await self._drop()
        raise NothingWaits

    async def room(self) -> int:
        await self._drop()
        return 0


@pytest.mark.parametrize("kind", ["worker", "queue"])
def test_a_dropped_cancellation_ends_it(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("firstfix_service.builds.nats.queue.ROOM_S", 0.01)
    monkeypatch.setattr("firstfix_service.builds.nats.queue.RECONCILE_S", 0.01)
    settings = Settings(
        store=f"file://{tmp_path}/store",
        work_dir=tmp_path / "work",
        build_queue="nats://127.0.0.1:1",
        shared_stages_max_bytes=0,
    )
    catalog = Catalog(Store.open(settings.store))

    async def main() -> None:
        builds: Any = DroppingBuilds()
        if kind == "queue":
            part: NatsBuildQueue | BuildWorker = NatsBuildQueue(settings, catalog, Metrics())
            part.builds = builds
        else:
            part = BuildWorker(settings, catalog, Metrics(), 1)
            monkeypatch.setattr(part, "_builds", builds)
            monkeypatch.setattr(part.queue, "run", asyncio.Event().wait)
        task = asyncio.create_task(part.run())
        await asyncio.wait_for(builds.called.wait(), LIMIT_S)
        task.cancel()
        ended, _ = await asyncio.wait({task}, timeout=LIMIT_S)
        assert ended, "it goes on"
        assert task.cancelled()

    asyncio.run(main())
