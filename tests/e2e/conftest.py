from __future__ import annotations

from tests.e2e.fixtures import index, localizer, parameters

__all__ = ["index", "localizer", "parameters"]
