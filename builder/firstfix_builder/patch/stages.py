"""The stages of a build whose source may be a patch of a version by kept queries."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.engine.calibration import Calibration
from firstfix.engine.index import CALIBRATION_FILE, MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildFailed, NothingToPatch

from ..execution.build_trace import within_a_stage
from ..execution.stage_cache import StageResult
from ..job.patch_source import BASE, PatchSource, is_patch_source
from ..mesh.places.tiled_points import TiledPoints
from ..sessions.stages import SessionStages
from ..sources.read_map.read_map import content_hash
from ..stage_files import link, simulator_of, spacing_m_of
from .compare import compare
from .confirm import Change, PatchRule, confirmed_changes
from .kept_scans import read_observations
from .map_patch import MapPatch, patch_of
from .observation import LeftOut, Seen, seen_by

PATCH_FILE = "patch.npz"  # of a version, too: the next patch is laid over it
RECORD_FILE, CELLS_FILE, COMPARED_FILE = "patch.json", "changed_cells.npy", "compared.json"
MOST_OF_CLOUD = 0.1  # a larger change is no patch: somebody must map the place again


@dataclass(frozen=True)
class PatchStages(SessionStages):
    """The stages of a build. The first one lays a patch into the map, if the source is one."""

    def read_source(self, source: Path, trajectory: Path | None) -> StageResult:
        """The map of a source; of a patch, the map with the changes that its queries confirm."""
        if not is_patch_source(source):
            return self.read_map(source, trajectory)
        told = PatchSource.load(source)
        with within_a_stage():
            poses = None if told.trajectory is None else source / told.trajectory
            read = self.read_map(source / told.source, poses)

        def produce(out: Path) -> None:
            _lay(source, told, read, spacing_m_of(read), out)

        inputs = {"source": content_hash(source), "map": read.digest}
        return self._stage("read_map", inputs, {"of": "patch"}, produce)

    def compare_patch(
        self, source: Path, read: StageResult, mesh: StageResult, index: StageResult, tested: StageResult
    ) -> StageResult | None:
        """Answers of the patched version and of the one before at unchanged places; None: it is no patch."""
        if not is_patch_source(source):
            return None

        def produce(out: Path) -> None:
            calibration = json.loads((tested.directory / CALIBRATION_FILE).read_text())
            after = MapIndex.load(index.directory, Calibration.from_mapping(calibration))
            found = compare(
                Localizer(MapIndex.load(source / BASE), explains=False),
                Localizer(after, explains=False),
                simulator_of(mesh),
                self.config.sensor_model,
                self.config.self_test,
                np.load(read.directory / CELLS_FILE),
                self.threads,
                self.cancelled,
            )
            (out / COMPARED_FILE).write_text(json.dumps(found.to_mapping()))

        inputs = {"map": read.digest, "mesh": mesh.digest, "index": index.digest, "tested": tested.digest}
        chosen = {
            "compared_with": PatchSource.load(source).base,
            "self_test": self.config.self_test.model_dump(mode="json"),
        }
        return self._stage("self_test", inputs, chosen, produce)


def patch_record(read: StageResult, compared: StageResult | None) -> dict[str, Any] | None:
    """Record of a patch for the version's manifest; None: the source is no patch."""
    path = read.directory / RECORD_FILE
    if not path.exists() or compared is None:
        return None
    told = json.loads((compared.directory / COMPARED_FILE).read_text())
    return {**json.loads(path.read_text()), "compared": told}


def _lay(source: Path, told: PatchSource, read: StageResult, voxel_m: float, out: Path) -> None:
    """Writes the map with the confirmed changes.

    Raises:
        NothingToPatch: nothing is confirmed.
        BuildFailed: too much has changed for a patch, or the source is not that of the version.
    """
    if not (read.directory / "points.npy").exists():
        raise BuildFailed("the map's source is a mesh, and only clouds can be patched: map the place again")
    index = MapIndex.load(source / BASE)
    if not np.allclose(index.T_map_level, np.load(read.directory / "T_map_level.npy"), atol=1e-6):
        raise BuildFailed("the version to patch was not built from this source")
    rule = PatchRule()
    seen, left_out = seen_by(index, read_observations(source, told))
    changes = confirmed_changes(seen, rule)
    if not changes:
        raise NothingToPatch(_nothing(seen, left_out, rule))
    cloud = np.load(read.directory / "points.npy")
    earlier = source / BASE / PATCH_FILE
    before = MapPatch.load(earlier) if earlier.exists() else MapPatch()
    current = before.lay(cloud)
    patch = patch_of(changes, seen, index, current, robots=rule.robots, voxel_m=voxel_m)
    if not len(patch.added) and not len(patch.removed):
        raise NothingToPatch(
            "nothing to patch: the robots do not agree about any point of the changed places"
        )
    if len(patch.added) + len(patch.removed) > MOST_OF_CLOUD * len(current):
        raise BuildFailed("over a tenth of the map has changed, which is no patch: map the place again")
    whole = before.then(patch)
    TiledPoints.of(whole.lay(cloud)).save(out)
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
        f"nothing to patch: no change is confirmed by {len(seen)} kept queries of {robots} robots on {days} "
        f"days ({left_out.replayed} more replayed, {left_out.doubtful} at a doubtful pose). It takes "
        f"{rule.robots} robots, {rule.days} days, and nobody who saw otherwise since"
    )
