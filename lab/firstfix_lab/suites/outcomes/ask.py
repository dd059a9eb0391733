"""Natural scans of one map and of other places, asked of a version of the map."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.quality import AlignmentQuality
from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.sensor import preset
from firstfix.transform import Matrix, pose_error
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.pipeline import build_version
from firstfix_builder.self_test import taught_outcomes as taught
from firstfix_builder.self_test.outcome import RIGHT_DEG, RIGHT_M
from firstfix_builder.self_test.threshold import FLOOR
from tests.recorded_data import SHARED

from ...common.worlds import Scenery, WorldFiles
from ..robust.cases import ALL, ANY, CLEAN, Case
from ..robust.queries import queries_of
from ..robust.sensors import asking_sensors
from .maps import MAPS, TaughtMap, real_scans

SEED = 91  # not that of another suite
HERE = (
    Case("all at once", ALL),
    Case("any sensor, all at once", ALL, queries=ANY, own_height=True),
    Case("changed, all at once", ALL, "changed"),
    Case("the world's own queries", CLEAN, "own queries"),
)
ELSEWHERE = (Case("a strange yard", ALL, "strange yard"), Case("other worlds", ALL, "other worlds"))
ALIKE = Case("look-alikes", ALL, "look-alikes")
ABROAD = 5  # other worlds
_NO_FILES = WorldFiles(Scenery(Path()))


@dataclass(frozen=True)
class Asked:
    """One answer.

    Attributes:
        own_threshold: that the map's own self-test shows.
        kind: as of ``TaughtOutcome``.
        case: name of the scan's case.
        claimed: probability of the best place; -1: no threshold from FLOOR on accepts it.
        right: whether that place is right.
        quality: of its fit; None: no place was found.
    """

    own_threshold: float
    kind: str
    case: str
    sensor: str
    claimed: float
    right: bool
    quality: AlignmentQuality | None


@dataclass(frozen=True)
class Sizes:
    """Number of scans of each case here, elsewhere, and of each look-alike."""

    here: int = 36
    elsewhere: int = 50
    alike: int = 24


def outcomes_of(one: TaughtMap, sizes: Sizes, work: Path) -> Iterator[Asked]:
    """Build a map's version as a user would, and ask it.

    Args:
        work: an existing folder, whose stage caches make a second run quick.
    """
    config = BuildConfig.parse(one.config)
    sensor = config.sensor_model
    rng = np.random.default_rng([SEED, crc32(one.name.encode())])
    if one.world is not None:
        files = one.world.make(StageCache(work))
        built = build_version(files.source, config, work, trajectory=files.map.trajectory)
        localizer = Localizer(MapIndex.load(built.directory), explains=False)
        for case in (*HERE, ALIKE):
            kind, count = (taught.ALIKE, sizes.alike) if case is ALIKE else (taught.HERE, sizes.here)
            for name, share in asking_sensors(case, one.world, count):
                asking = sensor if name is None else preset(name)
                for scan, T in queries_of(case, localizer.index, asking, files, [], share, rng):
                    yield _asked(localizer, kind, case.name, asking.name, scan, T)
    else:
        assert one.real is not None
        dataset = one.real.converted(work)
        files = _NO_FILES
        trajectory = dataset.write_trajectory(work / "trajectory.csv")
        built = build_version(dataset.map_path, config, work, trajectory=trajectory)
        localizer = Localizer(MapIndex.load(built.directory), explains=False)
        for scan, T in real_scans(dataset, work):
            yield _asked(localizer, taught.HERE, "real", sensor.name, scan, T)
    abroad = _abroad(one, work, rng)
    for case in ELSEWHERE:
        for scan, _ in queries_of(case, localizer.index, sensor, files, abroad, sizes.elsewhere, rng):
            yield _asked(localizer, taught.ELSEWHERE, case.name, sensor.name, scan, None)
    for path in sorted((SHARED / "strangers").glob("*.pcd")):
        yield _asked(
            localizer, taught.ELSEWHERE, "strangers", path.name.split("_")[1], read_scan_file(path), None
        )


def _abroad(one: TaughtMap, work: Path, rng: np.random.Generator) -> list[Scenery]:
    """Some simulated worlds of other places."""
    others = [other.world for other in MAPS if other.world is not None and other.place != one.place]
    there = [world for world in others if world.missing is None]
    return [there[row].make(StageCache(work)).map for row in rng.permutation(len(there))[:ABROAD].tolist()]


def _asked(
    localizer: Localizer, kind: str, case: str, sensor: str, scan: Scan, T_map_sensor: Matrix | None
) -> Asked:
    own = localizer.index.calibration.search_until
    answer = localizer.localize(scan, LocalizeOptions(min_probability=FLOOR))
    if not answer.hypotheses:
        return Asked(own, kind, case, sensor, -1.0, False, None)
    best = answer.hypotheses[0]
    right = False
    if T_map_sensor is not None:
        error_m, error_deg = pose_error(T_map_sensor, best.T_map_sensor)
        right = error_m <= RIGHT_M and error_deg <= RIGHT_DEG
    claimed = answer.probability if answer.verdict is Verdict.LOCALIZED else -1.0
    return Asked(own, kind, case, sensor, claimed, right, best.quality)
