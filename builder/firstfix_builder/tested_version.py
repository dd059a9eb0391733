"""The last stage of a build: the self-test of what the stages before it made, and its files."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from firstfix.builds.config import BuildConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FILE_NAME as BOUND_FILE
from firstfix.engine.index import CALIBRATION_FILE
from firstfix.engine.localizer import Localizer
from firstfix.transform import inverse

from .self_test.localizability import draw_localizability
from .self_test.mapped_places import MappedPlaces
from .self_test.real_scans import RealScans
from .self_test.reliability import draw_reliability
from .self_test.run import run_self_test
from .sources.read_map.held_out import HeldOut
from .stage_files import write_json
from .stage_results import REPORT_FILE, IndexFiles, LevelMap, MapMesh, MapViewpoints


@dataclass(frozen=True)
class SelfTestInputs:
    """Results that the self-test reads.

    Attributes:
        confirmed: folder of ``decode_confirmed``; None: no robot has confirmed a query.
    """

    read: LevelMap
    mesh: MapMesh
    viewpoints: MapViewpoints
    index: IndexFiles
    confirmed: Path | None

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
    sensor, index = config.sensor_model, results.index.load(Calibration())
    simulator, floor = results.mesh.simulator, results.viewpoints.floor
    found, calibration, bound, places = run_self_test(
        Localizer(index, explains=False),
        simulator,
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
    left_out = {"floor": floor and floor.to_mapping(), "moving": results.read.moving}
    mapped = MappedPlaces.of(index, results.read.trajectory, simulator, sensor)
    grid = found.localizability
    known = mapped and {"localizability": mapped.told_of(grid), "mapped": mapped.to_mapping(grid)}
    write_json(out / REPORT_FILE, {**found.to_mapping(), **left_out, **(known or {})})
    draw_reliability(found.reliability, out / "reliability.png")
    in_part = mapped.in_part if mapped else ()
    picture = out / "localizability.png"
    draw_localizability(results.index.map_points, places, picture, floor, in_part, results.read.marked_places)
