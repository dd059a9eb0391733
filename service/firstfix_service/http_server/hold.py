"""Holding an answer back, for callers that ask too fast."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

HOLD = "firstfix.hold"  # extension of the ASGI scope: a ``Hold``

Hold = Callable[[float], Awaitable[None]]
"""Waits for some seconds before the answer begins, or until the connection has ended.

No work is done for the caller meanwhile, so the connection gives its place to another if one is needed.
"""
