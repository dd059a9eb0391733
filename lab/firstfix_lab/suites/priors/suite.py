"""Asks scans of halls whose places look alike with right priors and with wrong ones.

    firstfix-lab priors [--halls NAME ...] [--count N] [--seed N] [--json FILE]

The map is the hall's own surface, without a trajectory, and gravity is given. A prior is *right* if its ball
holds the true place. *equal* are answers to wrong priors at a place where a sensor sees the same as at the
true one: nobody can tell these.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.builds.config import BuildConfig, PerturbConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix, make_transform, pose_error, rotation_z, transform_points, yaw_of
from firstfix_builder.pipeline import build_version
from firstfix_builder.self_test.equal_places import EQUAL, share_seen_alike
from firstfix_builder.self_test.outcome import RIGHT_DEG, RIGHT_M
from firstfix_builder.simulation.perturb import ScanCase, ScanSimulation

from .halls import HALLS, SENSOR, Hall

DOWN = np.array([0.0, 0.0, -1.0])  # gravity, as the scans are level
RADII_M = (2.5, 1.0)
YAW_RANGE_DEG, YAW_OFF_DEG = 45.0, 30.0
STEP_M = (1.0, 2.5)  # between the two scans of a sequence
COLUMNS = ("asked", "right", "false", "equal")


@dataclass(frozen=True)
class BuiltHall:
    """A hall, its version, and the simulation of scans in it."""

    hall: Hall
    localizer: Localizer
    simulation: ScanSimulation

    @classmethod
    def of(cls, hall: Hall) -> BuiltHall:
        """Build the version; it is read whole, so that nothing is left on disk."""
        config = BuildConfig.parse({"sensor": SENSOR})
        with tempfile.TemporaryDirectory() as name:
            source = hall.write(Path(name) / "hall.ply")
            built = build_version(source, config, Path(name) / "work")
            localizer = Localizer(MapIndex.load(built.directory), explains=False)
        clear = PerturbConfig(tilt_deg=0, strangers=0, unmapped=0, vanished=0)
        return cls(hall, localizer, ScanSimulation(hall.simulator, config.sensor_model, clear))

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """(n, 3) of the templates."""
        index = self.localizer.index
        return transform_points(index.T_map_level, index.cascade.templates.position_m.astype(np.float64))

    def is_equal(self, T_one: Matrix, T_other: Matrix) -> bool:
        """Whether a sensor sees the same at two poses."""
        simulation = self.simulation
        return share_seen_alike(simulation.simulator, simulation.sensor, T_one, T_other) > EQUAL


def measure(built: BuiltHall, count: int, seed: int) -> dict[str, Counter[str]]:
    """Counts of the answers, by the kind of the prior."""
    rng = np.random.default_rng(seed)
    found: dict[str, Counter[str]] = {}
    for case in built.simulation.cases(built.positions_m, 1.0, count, rng):
        for kind, scans, prior in _asked(built, case, rng):
            answer = built.localizer.localize(scans, LocalizeOptions(gravity=DOWN, prior=prior))
            counts = found.setdefault(kind, Counter())
            counts.update(["asked", *_judged(built, answer, case.T_level_sensor)])
    return found


def _asked(
    built: BuiltHall, case: ScanCase, rng: np.random.Generator
) -> Iterator[tuple[str, Scan | ScanSequence, Prior]]:
    """All queries of one place: kind, scans and prior."""
    T, scan = case.T_level_sensor, built.simulation.scan(case)
    yaw_deg = float(np.degrees(yaw_of(T)) + rng.uniform(-YAW_OFF_DEG, YAW_OFF_DEG))
    places_m = built.positions_m[rng.permutation(len(built.positions_m))]
    here_m = T[:3, 3]
    for radius_m in RADII_M:
        yield f"{radius_m} m, right", scan, Prior(here_m + _off(radius_m, rng), radius_m)
        yield f"{radius_m} m, wrong", scan, Prior(_far(places_m, here_m, radius_m), radius_m)
    radius_m = RADII_M[0]
    heading = (yaw_deg, YAW_RANGE_DEG)
    yield "heading, right", scan, Prior(here_m + _off(radius_m, rng), radius_m, *heading)
    yield "heading, wrong", scan, Prior(_far(places_m, here_m, radius_m), radius_m, *heading)
    for turn_deg, x, y in built.hall.symmetries:
        middle = np.array([x, y, 0.0])
        twin_m = rotation_z(np.radians(turn_deg)) @ (here_m - middle) + middle
        if np.linalg.norm(twin_m - here_m) > radius_m + RIGHT_M:
            yield "twin with the true heading, wrong", scan, Prior(twin_m, radius_m, *heading)
    two = _two_scans(built, case, places_m)
    if two is not None:
        yield "two scans, right", two, Prior(here_m + _off(radius_m, rng), radius_m)
        yield "two scans, wrong", two, Prior(_far(places_m, here_m, radius_m), radius_m)


def _two_scans(built: BuiltHall, case: ScanCase, places_m: NDArray[np.float64]) -> ScanSequence | None:
    """A scan from a place near by, and that of the case; None: there is no such place."""
    T, simulator = case.T_level_sensor, built.simulation.simulator
    away_m = np.linalg.norm(places_m - T[:3, 3], axis=1)
    near_m = places_m[(away_m > STEP_M[0]) & (away_m < STEP_M[1])]
    free = (
        near_m[simulator.is_way_free(np.tile(T[:3, 3], (len(near_m), 1)), near_m)] if len(near_m) else near_m
    )
    if not len(free):
        return None
    before = make_transform(T[:3, :3] @ rotation_z(0.3), free[0])
    earlier = ScanCase(before, case.seed + 1, case.elsewhere_m)
    return ScanSequence.along([built.simulation.scan(earlier), built.simulation.scan(case)], [before, T])


def _judged(built: BuiltHall, answer: Localization, T_map_sensor: Matrix) -> list[str]:
    if answer.verdict is not Verdict.LOCALIZED or answer.T_map_sensor is None:
        return []
    off_m, off_deg = pose_error(T_map_sensor, answer.T_map_sensor)
    if off_m <= RIGHT_M and off_deg <= RIGHT_DEG:
        return ["right"]
    return ["equal" if built.is_equal(T_map_sensor, answer.T_map_sensor) else "false"]


def _off(radius_m: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """(3,) offset of a right prior's middle from the truth."""
    angle, length_m = rng.uniform(0, 2 * np.pi), 0.75 * radius_m * np.sqrt(rng.uniform())
    return np.array([length_m * np.cos(angle), length_m * np.sin(angle), 0.0])


def _far(places_m: NDArray[np.float64], here_m: NDArray[np.float64], radius_m: float) -> NDArray[np.float64]:
    """(3,) the first place whose prior does not hold the truth."""
    far: NDArray[np.float64] = places_m[np.linalg.norm(places_m - here_m, axis=1) > 2 * radius_m + RIGHT_M][0]
    return far


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab priors", description=__doc__.split("\n\n")[0])
    parser.add_argument("--halls", nargs="+", choices=HALLS, default=list(HALLS))
    parser.add_argument("--count", type=int, default=16, help="places in each hall")
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the counts here")
    chosen = parser.parse_args(arguments)
    found = {}
    for name in chosen.halls:
        found[name] = measure(BuiltHall.of(HALLS[name]()), chosen.count, chosen.seed)
        print(f"{name:10}{'':36}" + "".join(f"{column:>8}" for column in COLUMNS))
        for kind, counts in found[name].items():
            print(f"{'':10}{kind:36}" + "".join(f"{counts[column]:8}" for column in COLUMNS), flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps(found) + "\n")
