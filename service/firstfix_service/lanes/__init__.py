"""Lanes: where work runs beside requests, in threads by kind of work or as background tasks.

Each kind of blocking work has threads of its own, so that slow work does not delay urgent work. Nothing runs
in the default executor of the event loop or in the framework's thread pool: all callers and all work would
share it.
"""

from __future__ import annotations

from .lane import Lane

__all__ = [
    "AUTH",
    "BUILDS",
    "CHANGES",
    "COPIES",
    "KEYS",
    "LISTS",
    "LOOKS",
    "READS",
    "SIGNATURES",
    "START",
    "UPKEEP",
    "Lane",
]

START = Lane("start", 8)  # opens resources at the start and closes them at the end
KEYS = Lane("keys", 2)  # reads API keys and the keys of the token issuer
AUTH = Lane("auth", 4)  # reads whether a caller may see the build that a request names
BUILDS = Lane("builds", 8)  # leases of builds, and how builds ended
READS = Lane("reads", 16)  # reads one small record of the catalog
LISTS = Lane("lists", 4)  # reads much of the catalog: pages of lists, pictures
SIGNATURES = Lane("signatures", 2)  # hashes the bodies of signed queries
LOOKS = Lane("looks", 2)  # lays scans over maps, for people who look at answers
CHANGES = Lane("changes", 4)  # activates versions, sets georeferences
COPIES = Lane("copies", 4)  # copies map files to the disk and to the store, and hashes them
UPKEEP = Lane("upkeep", 4)  # removes abandoned objects, stages and garbage; looks for unfinished builds
