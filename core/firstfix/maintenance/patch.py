"""Request of a patch: a build of a map's active version with the changes that kept queries confirm."""

from __future__ import annotations

from typing import Any

from ..builds.config import BuildConfig, PatchMode
from ..catalog.catalog import Catalog
from ..errors import Conflict
from .rebuild import active_request, record_again


def patch_request(catalog: Catalog, map_id: str, mode: PatchMode | None = None) -> dict[str, Any]:
    """The request of a build that patches a map.

    Args:
        mode: what becomes of the patched version; None: as the map's build config says.

    Raises:
        NotFound: no such map; or it must be submitted again, because its active version was built without a
            record, or its sources are gone.
        Conflict: patches of this map are off, or its active version is provisional.
    """
    base, request = active_request(catalog, map_id)
    if base in catalog.state(map_id).provisional:
        raise Conflict(f"the active version of map {map_id} is provisional: wait for the full one")
    mode = mode or BuildConfig.parse(request.get("config") or {}).patch
    if mode == "off":
        raise Conflict(
            f"patches of map {map_id} are off: name a mode, propose or activate, or build the map with "
            "patch: propose in its config"
        )
    return {**request, "patch": {"base": base, "mode": mode}}


def request_patch(catalog: Catalog, map_id: str, mode: PatchMode | None = None) -> str:
    """Record a build that patches a map. The build workers of the store find it there. Returns its id.

    Raises:
        NotFound, Conflict: as ``patch_request``.
    """
    return record_again(catalog, map_id, patch_request(catalog, map_id, mode))
