"""Which replicas hold a map: the first few by rendezvous hashing (highest random weight).

Every replica has a weight for every map, the first eight bytes (big-endian) of

    SHA-256 of  MAP_ID "/" REPLICA      in ASCII

and comes before those of a lower one; of two of the same weight, which nobody will see, the name that sorts
first. Whoever knows the replicas' names knows the order, without anybody being asked; a replica that goes
leaves the order of the others as it was, so no map moves but those that it held.
"""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import sha256


def weight(map_id: str, replica: str) -> int:
    """0 to 2^64 - 1."""
    return int.from_bytes(sha256(f"{map_id}/{replica}".encode("ascii")).digest()[:8], "big")


def rendezvous_order(map_id: str, replicas: Iterable[str]) -> list[str]:
    """The replicas, each once, the first holder of the map first."""
    return sorted(set(replicas), key=lambda replica: (-weight(map_id, replica), replica))


def rank(map_id: str, replica: str, others: Iterable[str]) -> int:
    """Place of a replica in the order of itself and others: 0 for the first."""
    own = (-weight(map_id, replica), replica)
    return sum((-weight(map_id, other), other) < own for other in set(others))
