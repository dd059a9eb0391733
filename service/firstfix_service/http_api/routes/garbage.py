"""Garbage collection of one map or of the whole store."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from firstfix.access.permissions import Scope
from firstfix.maintenance.garbage import DAY_S, Ages, Garbage, collect_garbage

from ...thread_pools import MAINTENANCE
from ..edge import needs
from ..parts import CatalogDep
from ..schema.api_models import GarbageReport
from ..schema.parameters import MapId

router = APIRouter(tags=["garbage"])
MAX_KEYS = 1000
DryRun = Annotated[bool, Query(description="report what would be removed, remove nothing")]
OlderThanH = Annotated[
    float,
    Query(ge=1, le=8760, description="minimum age in hours; younger objects may belong to work under way"),
]


@router.post("/maps/{map_id}/collect-garbage")
@needs(Scope.ADMIN)
@MAINTENANCE.route
def collect_garbage_of_map(
    map_id: MapId, catalog: CatalogDep, dry_run: DryRun = False, older_than_h: OlderThanH = 24.0
) -> GarbageReport:
    """Remove files of retired versions, of unfinished publishes, and sources that no build names."""
    ages = Ages(things_s=older_than_h * 3600)
    return _report(collect_garbage(catalog, map_id=map_id, ages=ages, dry_run=dry_run), dry_run)


@router.post("/collect-garbage")
@needs(Scope.ADMIN)
@MAINTENANCE.route
def collect_all_garbage(
    catalog: CatalogDep,
    dry_run: DryRun = False,
    older_than_h: OlderThanH = 24.0,
    builds_older_than_d: Annotated[
        float,
        Query(
            ge=1,
            le=3650,
            description="minimum age in days of records of builds without a version",
        ),
    ] = 30.0,
) -> GarbageReport:
    """Collects the garbage of all maps and of the store.

    Also removes abandoned uploads, idempotency keys, and old records of builds without a version.
    """
    ages = Ages(things_s=older_than_h * 3600, builds_s=builds_older_than_d * DAY_S)
    return _report(collect_garbage(catalog, ages=ages, dry_run=dry_run), dry_run)


def _report(found: Garbage, dry_run: bool) -> GarbageReport:
    return GarbageReport(
        dry_run=dry_run,
        objects={kind: len(keys) for kind, keys in found.keys.items()},
        keys={kind: keys[:MAX_KEYS] for kind, keys in found.keys.items()},
    )
