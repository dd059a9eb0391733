"""The one whose queries take turns with others: a caller, and the map that it asks."""

from __future__ import annotations

from dataclasses import dataclass

SEVERAL_MAPS = "*"  # all searches of more than one map take turns as one


@dataclass(frozen=True)
class Asker:
    """One of those who take turns.

    Attributes:
        caller: name of its ``Principal``. Without credentials it is an address: all who share one are one
            caller. All zenoh clients without a credential are one, too: zenoh does not say who asks.
        map_id: the map, or ``SEVERAL_MAPS``.
    """

    caller: str
    map_id: str
