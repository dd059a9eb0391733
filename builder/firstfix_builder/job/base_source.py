"""The version that a build may keep something of: the map's active one, fetched from the store."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path
from typing import Any

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import FILE_NAME, MADE_BY_FILE, SURFACE_FILE
from firstfix.errors import NotFound, TooLarge, VersionError

from ..stage_files import link_all

_log = logging.getLogger(__name__)
MAX_BYTES = 1 << 30  # of the surface's cells: a city of a thousand square kilometres has them


def with_base(catalog: Catalog, map_id: str, config: dict[str, Any]) -> dict[str, Any]:
    """The config of a build, with the map's active version as its base, unless it names one.

    A provisional version is no base.
    """
    state = catalog.state(map_id)
    if config.get("base") or state.active in (None, *state.provisional):
        return config
    return {**config, "base": state.active}


def collect_base(catalog: Catalog, map_id: str, config: dict[str, Any], folder: Path) -> Path | None:
    """Fetch the version that a config names as its base. Returns its folder.

    None, and a warning, where it is gone or damaged: the build then keeps nothing.

    Args:
        folder: made anew.

    Raises:
        StoreError: the store failed.
    """
    shutil.rmtree(folder, ignore_errors=True)
    base = config.get("base")
    if not base:
        return None
    try:
        manifest = catalog.manifest(map_id, base)
        fetched = catalog.fetch_version(map_id, base, folder / "fetched")
        link_all(fetched, folder / "version")
        besides = {FILE_NAME: manifest.to_json()}
        for name in (SURFACE_FILE, MADE_BY_FILE):  # no query's files
            if name in manifest.files:
                besides[name] = catalog.read_file(map_id, base, name, max_bytes=MAX_BYTES)
        for name, content in besides.items():
            path = folder / "version" / name
            path.unlink(missing_ok=True)  # it may be a link to the store's own
            path.write_bytes(content)
    except (NotFound, VersionError, TooLarge) as error:
        _log.warning("nothing is kept of version %s of map %s: %s", base[:12], map_id, error)
        shutil.rmtree(folder, ignore_errors=True)
        return None
    shutil.rmtree(folder / "fetched", ignore_errors=True)
    return folder / "version"
