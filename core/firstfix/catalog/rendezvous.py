"""Placement of maps on replicas by rendezvous hashing (highest random weight).

The weight of a replica for a map is the first eight bytes (big-endian) of

    SHA-256 of  MAP_ID "/" REPLICA      in ASCII

A replica with a higher weight comes first; of equal weights, the name that sorts first. The first few
replicas load the map. The names of the replicas determine the order, without any communication. When a
replica leaves, the order of the others does not change, so only the maps of that replica move.
"""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import sha256


def weight(map_id: str, replica: str) -> int:
    """Weight of a replica for a map, 0 to 2^64 - 1."""
    return int.from_bytes(sha256(f"{map_id}/{replica}".encode("ascii")).digest()[:8], "big")


def rendezvous_order(map_id: str, replicas: Iterable[str]) -> list[str]:
    """Replicas in the map's order, each once, highest weight first."""
    return sorted(set(replicas), key=lambda replica: (-weight(map_id, replica), replica))


def rank(map_id: str, replica: str, others: Iterable[str]) -> int:
    """Rank of a replica for a map among itself and others; 0 is the first."""
    own = (-weight(map_id, replica), replica)
    return sum((-weight(map_id, other), other) < own for other in set(others))
