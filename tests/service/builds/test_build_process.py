"""Process of a build when the service stops."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from firstfix_service.builds.process import BuildProcess


class Ending:
    """A process that ends when the test says so."""

    pid = 0

    def __init__(self) -> None:
        self.code: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    async def wait(self) -> int:
        return await self.code


@pytest.mark.parametrize("turns", range(5))
def test_who_waits_for_it_can_be_stopped_just_when_it_ends(tmp_path: Path, turns: int):
    async def main() -> None:
        ending = Ending()
        process = BuildProcess(ending, tmp_path / "log", None)  # type: ignore[arg-type]
        waiting = asyncio.create_task(process.wait(60.0))
        await asyncio.sleep(0.1)
        ending.code.set_result(0)
        for _ in range(turns):  # of the event loop, in which the end arrives
            await asyncio.sleep(0)
        if waiting.cancel():  # otherwise the end had arrived before
            with pytest.raises(asyncio.CancelledError):
                await waiting

    asyncio.run(main())
