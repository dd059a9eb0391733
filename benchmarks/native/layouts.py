"""Names that older checkouts have for the same things: modules, reasons, fields of a version."""

from __future__ import annotations

import json
import os
from importlib import import_module
from pathlib import Path
from typing import Any

_MODULES = {
    "MapIndex": ("firstfix.engine.index", "firstfix.map_index"),
    "Localizer": ("firstfix.engine.localizer", "firstfix.localizer"),
    "BuildConfig": ("firstfix.builds.config", "firstfix.build_config"),
}
# Name in an older checkout to the name here.
REASONS = {"low_overlap": "low_inlier_ratio"}
_FIELDS = {
    "settle_iterations": "align_iterations",
    "closeness": "alignment_score",
    "min_overlap": "min_inlier_ratio",
}


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


def in_this_layout(version: Path, out: Path) -> Path:
    """Links a version's files to a new folder, and gives its fields the names of this checkout."""
    out.mkdir(parents=True)
    for path in version.iterdir():
        if path.name in ("engine.json", "calibration.json"):
            (out / path.name).write_text(json.dumps(json.loads(path.read_text(), object_hook=_renamed)))
        elif path.name != "manifest.json":  # it has the digests of the files before
            os.link(path, out / path.name)
    return out


def _renamed(fields: dict[str, Any]) -> dict[str, Any]:
    return {_FIELDS.get(name, name): value for name, value in fields.items()}
