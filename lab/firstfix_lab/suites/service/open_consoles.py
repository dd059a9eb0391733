"""Consoles without a browser, in a process of their own.

python -m firstfix_lab.suites.service.open_consoles URL MAP VERSION COUNT

A line ``on`` opens them all, ``off`` closes them, and the end of the input ends the process. Each has the
start page open, watches the answers, opens the map's cloud as far as a browser shows it, and then looks at
another node every second. The process prints at last what was read, as JSON.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import sys
from collections import Counter
from typing import Any

import httpx

SHOWN_POINTS = 1_500_000  # plugins/console/page/src/map3d/levels.ts
MAX_TOGETHER = 100_000  # plugins/console/page/src/map3d/loads.ts
LOOK_S = 1.0  # between two nodes
START_PAGE_S = 5.0  # plugins/console/page/src/maps/MapList.tsx and answerCounts.ts
ALERTS_S = 15.0  # plugins/console/page/src/live/useMapAlerts.ts
OPENED_WITHIN_S = 600.0  # on a slow machine too


class Console:
    """One person's console."""

    def __init__(self, http: httpx.AsyncClient, map_id: str, version: str, number: int) -> None:
        self._http = http
        self._map_id = map_id
        self._path = f"/maps/{map_id}/versions/{version}/cloud"
        self._random = random.Random(number)
        self.read: Counter[str] = Counter()
        self.has_opened, self.has_heard = asyncio.Event(), asyncio.Event()

    async def watch(self) -> None:
        """Read the answers as they come."""
        async with self._http.stream("GET", "/answers/events", params={"map_id": self._map_id}) as answer:
            answer.raise_for_status()
            async for line in answer.aiter_lines():
                self.read["bytes"] += len(line)
                if line.startswith("event: answer"):
                    self.read["answers"] += 1
                    self.has_heard.set()

    async def read_start_page(self) -> None:
        """Read all maps and their answers time after time, as the start page does."""
        while True:
            await self._get("/maps", {"limit": 1000})
            await self._get("/answers/counts", {})
            await asyncio.sleep(START_PAGE_S)

    async def read_alerts(self) -> None:
        """Read time after time of what Live makes alerts."""
        while True:
            await self._get("/recorded-queries", {"map_id": self._map_id, "limit": 200})
            await self._get("/builds", {"map_id": self._map_id, "limit": 20})
            await asyncio.sleep(ALERTS_S)

    async def look(self) -> None:
        """Open the cloud and looks around in it."""
        index = json.loads(await self._get(self._path, {}))
        for first, count in shown_runs(index["nodes"]):
            await self._get(f"{self._path}/points", {"first": first, "count": count})
        self.read["opened"] += 1
        self.has_opened.set()
        while True:
            await asyncio.sleep(LOOK_S)
            *_, first, count = self._random.choice(index["nodes"])
            await self._get(f"{self._path}/points", {"first": first, "count": count})

    async def _get(self, path: str, params: dict[str, Any]) -> bytes:
        answer = await self._http.get(path, params=params)
        answer.raise_for_status()
        self.read["bytes"] += len(answer.content)
        return answer.content


def shown_runs(nodes: list[list[int]]) -> list[tuple[int, int]]:
    """First point and number of points of each request for the nodes that are shown at first."""
    runs: list[tuple[int, int]] = []
    shown = 0
    for *_, first, count in nodes:
        shown += count
        if shown > SHOWN_POINTS:
            break
        start, together = runs[-1] if runs else (0, 0)
        if runs and start + together == first and together + count <= MAX_TOGETHER:
            runs[-1] = start, together + count
        else:
            runs.append((first, count))
    return runs


async def open_all(consoles: list[Console]) -> None:
    """Open consoles until it is cancelled."""
    async with asyncio.TaskGroup() as group:
        for one in consoles:
            group.create_task(one.read_start_page())
            group.create_task(one.read_alerts())
            group.create_task(one.watch())
            group.create_task(one.look())


async def close_all(opening: asyncio.Task[None], consoles: list[Console]) -> None:
    """Close consoles after each of them has shown the map and heard an answer.

    Raises:
        ExceptionGroup: the service refused one.
        TimeoutError: the service did not give what they show.
    """
    shown = asyncio.gather(*(event.wait() for one in consoles for event in (one.has_opened, one.has_heard)))
    ended, _ = await asyncio.wait({opening, shown}, timeout=OPENED_WITHIN_S, return_when="FIRST_COMPLETED")
    if opening in ended:
        opening.result()  # it never ends by itself: an error is one of the service
    if not ended:
        raise TimeoutError("a console did not open, or heard no answer")
    opening.cancel()
    await asyncio.wait({opening})


async def main(url: str, map_id: str, version: str, count: int) -> None:
    limits = httpx.Limits(max_connections=None)
    async with httpx.AsyncClient(base_url=url, timeout=httpx.Timeout(60.0), limits=limits) as http:
        consoles = [Console(http, map_id, version, number) for number in range(count)]
        opening: asyncio.Task[None] | None = None
        while order := await asyncio.to_thread(sys.stdin.readline):
            if opening is not None:
                await close_all(opening, consoles)
            opening = asyncio.create_task(open_all(consoles)) if order.strip() == "on" else None
            print("done", flush=True)
        if opening is not None:
            await close_all(opening, consoles)
    print(json.dumps(dict(sum((one.read for one in consoles), Counter()))), flush=True)


if __name__ == "__main__":
    os.nice(19)  # consoles run on other machines: here they take what is left
    asyncio.run(main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])))
