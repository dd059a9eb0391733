"""What a replica says of itself over zenoh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ReplicaInfo:
    """One replica, as it describes itself.

    Attributes:
        service_version: of its software.
        maps: map id to the version that it answers with; None: it has loaded none yet.
        queries, limit: that wait or run there, and how many may.
        held: maps that are this replica's to hold; None: the replicas share nothing.
    """

    replica: str
    service_version: str
    maps: Mapping[str, str | None]
    queries: int
    limit: int
    held: int | None = None

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> ReplicaInfo:
        load, holding = data.get("load", {}), data.get("holding")
        return cls(
            str(data["replica"]),
            str(data.get("service_version", "")),
            dict(data.get("maps", {})),
            int(load.get("queries", 0)),
            int(load.get("limit", 0)),
            None if holding is None else int(holding["maps"]),
        )
