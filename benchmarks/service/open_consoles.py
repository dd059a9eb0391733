"""Consoles without a browser, in a process of their own.

python -m benchmarks.service.open_consoles URL MAP VERSION COUNT

A line ``on`` opens them all, ``off`` closes them, and the end of the input ends the process. Each watches the
answers, opens the map's cloud as far as a browser shows it, and then looks at another node every second. The
process prints at last what was read, as JSON.
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

SHOWN_POINTS = 1_500_000  # console/src/map3d/levels.ts
LOOK_S = 1.0  # between two nodes


class Console:
    """One person's console."""

    def __init__(self, http: httpx.AsyncClient, map_id: str, version: str, number: int) -> None:
        self._http = http
        self._map_id = map_id
        self._path = f"/maps/{map_id}/versions/{version}/cloud"
        self._random = random.Random(number)
        self.read: Counter[str] = Counter()

    async def watch(self) -> None:
        """Reads the answers as they come."""
        async with self._http.stream("GET", "/answers/events", params={"map_id": self._map_id}) as answer:
            answer.raise_for_status()
            async for line in answer.aiter_lines():
                self.read["answers"] += line.startswith("event: answer")
                self.read["bytes"] += len(line)

    async def look(self) -> None:
        """Opens the cloud and looks around in it."""
        await self._get("/maps", {})
        index = json.loads(await self._get(self._path, {}))
        shown = 0
        for *_, first, count in index["nodes"]:
            if shown + count > SHOWN_POINTS:
                break
            shown += count
            await self._get(f"{self._path}/points", {"first": first, "count": count})
        self.read["opened"] += 1
        while True:
            await asyncio.sleep(LOOK_S)
            *_, first, count = self._random.choice(index["nodes"])
            await self._get(f"{self._path}/points", {"first": first, "count": count})

    async def _get(self, path: str, params: dict[str, Any]) -> bytes:
        answer = await self._http.get(path, params=params)
        answer.raise_for_status()
        self.read["bytes"] += len(answer.content)
        return answer.content


async def closed(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        if task.done():
            task.result()  # it never ends by itself: an error is one of the service
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def main(url: str, map_id: str, version: str, count: int) -> None:
    limits = httpx.Limits(max_connections=None)
    async with httpx.AsyncClient(base_url=url, timeout=httpx.Timeout(60.0), limits=limits) as http:
        consoles = [Console(http, map_id, version, number) for number in range(count)]
        tasks: list[asyncio.Task[None]] = []
        while order := await asyncio.to_thread(sys.stdin.readline):
            await closed(tasks)
            opened = consoles if order.strip() == "on" else []
            tasks = [asyncio.create_task(do()) for one in opened for do in (one.watch, one.look)]
            print("done", flush=True)
        await closed(tasks)
    print(json.dumps(dict(sum((one.read for one in consoles), Counter()))), flush=True)


if __name__ == "__main__":
    os.nice(19)  # consoles run on other machines: here they take what is left
    asyncio.run(main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])))
