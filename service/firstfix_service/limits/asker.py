"""Callers and maps whose queries take turns."""

from __future__ import annotations

from typing import NamedTuple


class Asker(NamedTuple):
    """One of those whose queries take turns.

    Attributes:
        caller: name of its ``Principal``. Without credentials it is an address: all who share one are one
            caller. All zenoh clients without a credential are one, too: zenoh does not say who asks.
        map_id: the map, or all searches of several maps as one; empty: no map.
    """

    caller: str
    map_id: str
