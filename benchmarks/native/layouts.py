"""Names of the core in this checkout's layout, and in that of the checkouts before it had rooms."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_MODULES = {
    "MapIndex": ("firstfix.engine.index", "firstfix.map_index"),
    "Localizer": ("firstfix.engine.localizer", "firstfix.localizer"),
    "BuildConfig": ("firstfix.builds.config", "firstfix.build_config"),
}
# Reasons that an older checkout calls by another name.
REASONS = {"low_overlap": "low_inlier_ratio"}


def core(name: str) -> Any:
    """Returns a class of the core that is on the path.

    Raises:
        ImportError: neither layout has it.
    """
    here, before = _MODULES[name]
    try:
        return getattr(import_module(here), name)
    except ModuleNotFoundError as error:
        if error.name is None or not here.startswith(error.name):
            raise
        return getattr(import_module(before), name)
