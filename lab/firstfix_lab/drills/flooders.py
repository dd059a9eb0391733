"""The process of the caller that floods: it asks for all that it may, up to every limit that it has.

    python -m firstfix_lab.drills.flooders 'heavy scans' --url URL --map yard --version DIGEST --key ffx_...

It asks this machine alone, from a loopback address of its own, at low priority: so that the other caller's
figures show the service, and not this process. Prints how often it met what, as JSON.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import signal
import sys
from collections import Counter
from urllib.parse import urlsplit

from .floods import FLOODS, Flood, Target, connect
from .route_floods import route_floods

NICENESS = 10


def all_floods() -> dict[str, Flood]:
    """Every flood by its name."""
    return FLOODS | route_floods()


async def flood(chosen: Flood, target: Target, seconds: float) -> Counter[str]:
    """Floods until SIGTERM, or for so many seconds. Returns how often it met what."""
    seen: Counter[str] = Counter()

    async def one() -> None:
        while True:
            try:
                reader, writer = await connect(target.port)
            except OSError:
                seen["no connection"] += 1
                await asyncio.sleep(0.2)
                continue
            seen["connections"] += 1
            try:
                await chosen.act(target, reader, writer, seen)
            except (OSError, EOFError):
                seen["ended"] += 1
                await asyncio.sleep(0.05)
            finally:
                writer.transport.abort()

    told = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, told.set)
    tasks = [asyncio.create_task(one()) for _ in range(chosen.connections)]
    print("begun", flush=True)
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(told.wait(), seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return seen


def main() -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab .flooders", description=__doc__)
    parser.add_argument("flood", help="one of ``firstfix_lab.drills.floods`` or ``route_floods``")
    parser.add_argument("--url", required=True)
    parser.add_argument("--endpoint", default="")
    parser.add_argument("--map", required=True, metavar="ID")
    parser.add_argument("--version", required=True, metavar="DIGEST")
    parser.add_argument("--key", required=True)
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    os.nice(NICENESS)
    target = Target(urlsplit(given.url).port or 80, given.endpoint, given.map, given.version, given.key)
    seen = asyncio.run(flood(all_floods()[given.flood], target, given.seconds))
    json.dump(seen, sys.stdout)
    sys.stdout.flush()
    os._exit(0)  # zenoh's threads may wait for a service that owes them replies


if __name__ == "__main__":
    main()
