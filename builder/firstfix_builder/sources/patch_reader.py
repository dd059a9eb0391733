"""The reader of a patch: changes that recorded queries of several robots confirm, over a map's own source."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.index import MapIndex
from firstfix.errors import BuildFailed, NothingToPatch

from ..job.patch_source import BASE, PatchSource, is_patch_source
from ..stage_files import link
from ..stage_results import LevelMap
from .patch.confirm import Change, PatchRule, confirmed_changes
from .patch.map_patch import MapPatch, patch_of
from .patch.observation import LeftOut, Seen, seen_by
from .patch.recorded_scans import read_observations
from .reading import Reading
from .write_level_map import write_cloud

PATCH_FILE = "patch.npz"  # of a version, too: the next patch is laid over it
RECORD_FILE, CELLS_FILE = "patch.json", "changed_cells.npy"
MAX_OF_CLOUD = 0.1  # a larger change is no patch: somebody must map the place again


class PatchReader:
    """Reads the folder of a patch (``job.patch_source``): the map with what its queries confirm."""

    def can_read(self, path: Path) -> bool:
        """Whether a source is such a folder."""
        return is_patch_source(path)

    def read(self, path: Path, trajectory: Path | None, reading: Reading) -> LevelMap:
        """The map with the confirmed changes.

        Raises:
            NothingToPatch: nothing is confirmed.
            BuildFailed: too much has changed for a patch, or the source is not that of the version.
        """
        told = PatchSource.load(path)
        read = reading.within(path / told.source, None if told.trajectory is None else path / told.trajectory)

        def produce(out: Path) -> None:
            _lay(path, told, read, out)

        return reading.stage(path, None, produce, map=read.digest)


@dataclass(frozen=True)
class PatchedMap(LevelMap):
    """A map with a patch."""

    @property
    def changed_cells(self) -> NDArray[np.int64]:
        """(n, 3) cells of the map that have changed."""
        cells: NDArray[np.int64] = np.load(self.directory / CELLS_FILE)
        return cells

    @property
    def patch(self) -> Path:
        """File of the points that were added and removed, for the next patch."""
        return self.directory / PATCH_FILE

    @property
    def record(self) -> dict[str, Any]:
        """Summary of what was laid into the map, for the version's manifest."""
        record: dict[str, Any] = json.loads((self.directory / RECORD_FILE).read_text())
        return record


def _lay(source: Path, told: PatchSource, read: LevelMap, out: Path) -> None:
    """Write the map with the confirmed changes; raises as ``PatchReader.read`` does."""
    if read.is_mesh:
        raise BuildFailed("the map's source is a mesh, and only clouds can be patched: map the place again")
    index = MapIndex.load(source / BASE)
    if not np.allclose(index.T_map_level, read.T_map_level, atol=1e-6):
        raise BuildFailed("the version to patch was not built from this source")
    rule = PatchRule()
    seen, left_out = seen_by(index, read_observations(source, told))
    changes = confirmed_changes(seen, rule)
    if not changes:
        raise NothingToPatch(_nothing(seen, left_out, rule))
    cloud = read.points
    earlier = source / BASE / PATCH_FILE
    before = MapPatch.load(earlier) if earlier.exists() else MapPatch()
    current = before.lay(cloud)
    patch = patch_of(changes, seen, index, current, robots=rule.robots, voxel_m=read.spacing_m)
    if not len(patch.added) and not len(patch.removed):
        raise NothingToPatch(
            "nothing to patch: the robots do not agree about any point of the changed places"
        )
    if len(patch.added) + len(patch.removed) > MAX_OF_CLOUD * len(current):
        raise BuildFailed("over a tenth of the map has changed, which is no patch: map the place again")
    whole = before.then(patch)
    bright = read.intensity
    write_cloud(whole.lay(cloud), None if bright is None else whole.shade(cloud, bright), out)
    whole.save(out / PATCH_FILE)
    np.save(out / CELLS_FILE, np.concatenate([change.cells for change in changes]))
    record = _record(told.base, changes, seen, left_out, patch)
    (out / RECORD_FILE).write_text(json.dumps(record, sort_keys=True))
    for path in read.directory.iterdir():
        if not path.name.startswith("point"):
            link(path, out / path.name)


def areas_of(changes: list[Change]) -> list[dict[str, Any]]:
    """The areas of changes, ready for JSON."""
    found = []
    for change in changes:
        for area in change.areas:
            low_m, high_m = area.box_m
            found.append(
                {
                    "kind": area.kind,
                    "low_m": low_m.tolist(),
                    "high_m": high_m.tolist(),
                    "robots": len(change.robots),
                    "days": change.days,
                }
            )
    return found


def _record(
    base: str, changes: list[Change], seen: list[Seen], left_out: LeftOut, patch: MapPatch
) -> dict[str, Any]:
    return {
        "base": base,
        "areas": areas_of(changes),
        "added_points": len(patch.added),
        "removed_points": len(patch.removed),
        "queries": len(seen),
        "robots": len({one.observation.robot for one in seen}),
        "replayed": left_out.replayed,
        "doubtful": left_out.doubtful,
    }


def _nothing(seen: list[Seen], left_out: LeftOut, rule: PatchRule) -> str:
    """The reason for which nothing is laid into the map."""
    robots = len({one.observation.robot for one in seen})
    days = len({int(one.observation.time_s // 86400) for one in seen})
    return (
        f"nothing to patch: no change is confirmed by {len(seen)} recorded queries of {robots} robots on "
        f"{days} days ({left_out.replayed} more replayed, {left_out.doubtful} at a doubtful pose). It takes "
        f"{rule.robots} robots, {rule.days} days, and nobody who saw otherwise since"
    )
