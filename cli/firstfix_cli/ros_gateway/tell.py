"""Lines about robots, for the operator."""

from __future__ import annotations

from collections.abc import Callable

Tell = Callable[[str, str], None]  # a robot's namespace and a line about it
