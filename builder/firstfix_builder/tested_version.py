"""The last stage of a build: the self-test of what the stages before it made, and its files."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firstfix.builds.config import BuildConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FILE_NAME as BOUND_FILE
from firstfix.engine.index import CALIBRATION_FILE, MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import inverse

from .rebuild.kept import TAUGHT_ANEW, Kept
from .self_test.changed_part import ChangedPart, ChangedPartTested
from .self_test.localizability import QueriedPlace, draw_localizability
from .self_test.mapped_places import MappedPlaces
from .self_test.real_scans import RealScans
from .self_test.reliability import draw_reliability
from .self_test.run import run_self_test
from .sources.read_map.held_out import HeldOut
from .stage_files import link, write_json
from .stage_results import REPORT_FILE, IndexFiles, LevelMap, MapMesh, MapViewpoints

_log = logging.getLogger(__name__)
RELIABILITY_PICTURE = "reliability.png"


@dataclass(frozen=True)
class SelfTestInputs:
    """Results that the self-test reads.

    Attributes:
        confirmed: folder of ``decode_confirmed``; None: no robot has confirmed a query.
        kept: what the index has of the version before; None: nothing.
    """

    read: LevelMap
    mesh: MapMesh
    viewpoints: MapViewpoints
    index: IndexFiles
    confirmed: Path | None
    kept: Kept | None = None

    def real_scans(self) -> RealScans:
        """The scans that were held out of the map, and the confirmed ones, in the level frame."""
        told = HeldOut() if self.confirmed is None else HeldOut.load(self.confirmed)
        told = told.moved(inverse(self.read.T_map_level))
        return RealScans.of(HeldOut.load(self.read.directory), self.index.map_points, told)


def write_self_test(
    results: SelfTestInputs,
    config: BuildConfig,
    executor: Executor,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
    out: Path,
) -> None:
    """Run the self-test and write the calibration, the report and its pictures to the stage's folder.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    besides: dict[str, Any] = {} if results.kept is None else {TAUGHT_ANEW: True}
    if results.kept is not None and config.self_test.until_decided:
        tested = _write_kept(results.kept, results, config, executor, progress, cancelled, out)
        if tested.holds:
            return
        _log.info("the calibration of the version before does not hold: the whole self-test is run")
        besides |= tested.parts
    sensor, index = config.sensor_model, results.index.load(Calibration())
    found, calibration, bound, places = run_self_test(
        Localizer(index, explains=False),
        results.mesh.simulator,
        sensor,
        config.self_test,
        config.activate,
        results.real_scans(),
        executor,
        progress,
        cancelled,
    )
    write_json(out / CALIBRATION_FILE, calibration.to_mapping())
    write_json(out / BOUND_FILE, bound.to_mapping())
    _write_report(results, config, index, {**found.to_mapping(), **besides}, places, out)
    draw_reliability(found.reliability, out / RELIABILITY_PICTURE)


def _write_kept(
    kept: Kept,
    results: SelfTestInputs,
    config: BuildConfig,
    executor: Executor,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
    out: Path,
) -> ChangedPartTested:
    """Test the changed part, and write what is kept of the version before if the calibration holds.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    base = kept.base
    index = results.index.load(base.calibration)
    part = ChangedPart(kept.changed.rows, kept.changed.share, base.manifest.self_test, base.calibration)
    found = part.test(
        Localizer(index, explains=False),
        results.mesh.simulator,
        config.sensor_model,
        config.self_test,
        results.real_scans(),
        executor,
        progress,
        cancelled,
    )
    if not found.holds:
        return found
    for name in (CALIBRATION_FILE, BOUND_FILE, RELIABILITY_PICTURE):
        link(base.directory / name, out / name)
    _write_report(results, config, index, found.report, found.places, out)
    return found


def _write_report(
    results: SelfTestInputs,
    config: BuildConfig,
    index: MapIndex,
    report: Mapping[str, Any],
    places: Sequence[QueriedPlace],
    out: Path,
) -> None:
    """Write the report, with what was left out of floor and cloud and mapped in part, and its picture."""
    read, floor = results.read, results.viewpoints.floor
    left_out = {"floor": floor and floor.to_mapping(), "moving": read.moving}
    mapped = MappedPlaces.of(index, read.trajectory, results.mesh.simulator, config.sensor_model)
    grid = report["localizability"]
    known = mapped and {"localizability": mapped.told_of(grid), "mapped": mapped.to_mapping(grid)}
    write_json(out / REPORT_FILE, {**report, **left_out, **(known or {})})
    in_part = mapped.in_part if mapped else ()
    picture = out / "localizability.png"
    draw_localizability(results.index.map_points, places, picture, floor, in_part, read.marked_places)
