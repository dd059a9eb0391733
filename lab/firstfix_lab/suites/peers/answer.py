"""The answer of a peer to one scan: pose, confidence, and whether it is accepted."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.transform import Matrix


@dataclass(frozen=True)
class Answer:
    """The best pose of a peer.

    Attributes:
        T_map_sensor: (4, 4); None: there is none.
        confidence: the peer's own measure, 0 or larger; larger: surer. Only the order is used.
        is_accepted: the measure reaches the threshold that the peer's authors recommend.
    """

    T_map_sensor: Matrix | None = None
    confidence: float | None = None
    is_accepted: bool = False
