"""Thread pools: where work runs beside requests, in threads by kind of work or as background tasks.

Each kind of blocking work has threads of its own, so that slow work does not delay urgent work. Nothing runs
in the default executor of the event loop or in the framework's thread pool: all callers and all work would
share it.
"""

from __future__ import annotations

import asyncio

from .thread_pool import ThreadPool

__all__ = [
    "AUTH",
    "BUILDS",
    "CHANGES",
    "CHOICES",
    "COPIES",
    "KEYS",
    "LISTS",
    "METRICS",
    "PICTURES",
    "READS",
    "SIGNATURES",
    "START",
    "MAINTENANCE",
    "ThreadPool",
    "give_up_requests",
]

TURN_WITHIN_S = 10.0  # of work that takes a moment where the store answers: beyond it 503

START = ThreadPool("start", 8)  # opens resources at the start and closes them at the end
KEYS = ThreadPool("keys", 2)  # reads API keys and the keys of the token issuer
AUTH = ThreadPool("auth", 4, TURN_WITHIN_S)  # reads whether a caller may see the build that a request names
BUILDS = ThreadPool("builds", 8)  # leases of builds, and how builds ended
READS = ThreadPool("reads", 16, TURN_WITHIN_S)  # reads one small record of the catalog
LISTS = ThreadPool("lists", 4, TURN_WITHIN_S)  # reads much of the catalog: pages of lists, pictures
SIGNATURES = ThreadPool("signatures", 2)  # hashes the bodies of signed queries
PICTURES = ThreadPool("pictures", 2)  # draws maps
METRICS = ThreadPool("metrics", 2)  # puts metrics and counts together, which are in memory
CHANGES = ThreadPool("changes", 4, TURN_WITHIN_S)  # activates versions, sets georeferences
CHOICES = ThreadPool("choices", 2)  # chooses the maps of queries that name none
COPIES = ThreadPool("copies", 4)  # copies map files to the disk and to the store, and hashes them
MAINTENANCE = ThreadPool(
    "maintenance", 4
)  # removes abandoned objects, stages and garbage; looks for unfinished builds

_OF_REQUESTS = (KEYS, AUTH, READS, LISTS, PICTURES, CHANGES, CHOICES, COPIES, MAINTENANCE)
_AGAIN_S = 0.5  # a request may go on to other work


async def give_up_requests(after_s: float, why: str) -> None:
    """End what requests of this event loop wait for after some time, and from then on, until cancelled."""
    await asyncio.sleep(after_s)
    while True:
        for pool in _OF_REQUESTS:
            pool.give_up_requests(why)
        await asyncio.sleep(_AGAIN_S)
