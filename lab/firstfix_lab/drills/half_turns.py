"""Scans of a part of the turn: a LiDAR that sees a sector must not be taken for one in a wrong frame.

    firstfix-lab half_turns [--places hall,street,yard,office] [--scans N] [--work DIR]
    firstfix-lab half_turns --built DIR [...]

Held-out scans of the real places are cut to windows of 240 to 60 degrees at every 45 degrees of azimuth.
No answer may be turned away, or with the right pose first said to be of a wrong frame, and none may be
false. The scans of the simulated office are moved as the wrong inputs of ``tests/e2e`` are (into the map's
frame, and 10 m away): each must be named, none localized. Maps are built with their usual config below
``--work``. ``--built`` is such a folder, of PLACE/version, in which nothing is built: so two states of the
code are compared on the same maps.
"""

from __future__ import annotations

import argparse
import random
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.findings.scan_kinds import NO_VIEWPOINT, OTHER_VIEWPOINT
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import Matrix, pose_error, transform_points
from firstfix_builder.pipeline import build_version
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_cli.sample_world import write_world
from tests.recorded_data import HALL, STREET, YARD, Dataset

from ..common.markdown import table
from ..evaluation.outcome import FALSE_DEG, FALSE_M
from ..worlds import make_world

Points = NDArray[np.float32]
OFFICE = "office"  # a world of ``firstfix world``
PLACES = {place.name: place for place in (HALL, STREET, YARD)}
WORK = Path("build/half_turns")
SEED = 2  # of the scans that are drawn
FULL_DEG = 360
WIDTHS_DEG = (240, 180, 120, 90, 60)
HEADINGS_DEG = tuple(range(-180, 180, 45))
RIGHT_M, RIGHT_DEG = 0.5, 3.0  # true poses of the street are known to 0.4 m
HALL_AT_90 = 0.9  # share localized and right
OFFSET_M = (8.0, -6.0, 0.0)  # of another frame, as in tests/e2e/wrong_inputs.py
FAR_M = 5.0  # from the map's origin: nearer, nobody can tell the map's frame
CODES = {OTHER_VIEWPOINT.code, NO_VIEWPOINT.code}


def window(points: Points, width_deg: float, heading_deg: float) -> Points:
    """The points, of (n, 3), within a sector of azimuth about a heading."""
    off_deg = np.degrees(np.arctan2(points[:, 1], points[:, 0])) - heading_deg
    return points[np.abs((off_deg + 180) % 360 - 180) < width_deg / 2]


def windows(points: Points) -> Iterator[tuple[int, Points]]:
    """The whole scan, and its windows: width in degrees, and (n, 3) points."""
    yield FULL_DEG, points
    for width_deg in WIDTHS_DEG:
        for heading_deg in HEADINGS_DEG:
            yield width_deg, window(points, width_deg, heading_deg)


@dataclass(frozen=True)
class Told:
    """Answer to a scan that was taken at a known pose.

    Attributes:
        named: said to be in a wrong frame, whatever the verdict.
        turned_away: not localized for that reason.
    """

    verdict: Verdict
    reason: str
    is_right: bool
    is_right_first: bool
    is_false: bool
    named: bool
    turned_away: bool

    @classmethod
    def of(cls, answer: Localization, T_map_sensor: Matrix) -> Told:
        best = answer.hypotheses[0].T_map_sensor if answer.hypotheses else None
        off_m, off_deg = (np.inf, np.inf) if best is None else pose_error(T_map_sensor, best)
        localized = answer.verdict is Verdict.LOCALIZED
        is_right = off_m < RIGHT_M and off_deg < RIGHT_DEG
        return cls(
            answer.verdict,
            answer.reasons[0].value if answer.reasons else "",
            localized and is_right,
            is_right,
            localized and not (off_m <= FALSE_M and off_deg <= FALSE_DEG),
            is_named(answer),
            Reason.WRONG_FRAME in answer.reasons,
        )


def is_named(answer: Localization) -> bool:
    """Whether an answer says that the scan is in a wrong frame."""
    return any(finding.code in CODES for finding in answer.findings)


def ask(localizer: Localizer, scans: Sequence[tuple[Points, Matrix]]) -> dict[int, list[Told]]:
    """The answers to all windows of scans, by their width in degrees."""
    told: dict[int, list[Told]] = {}
    for points, T_map_sensor in scans:
        for width_deg, part in windows(points):
            answer = localizer.localize(Scan.from_points(np.ascontiguousarray(part)))
            told.setdefault(width_deg, []).append(Told.of(answer, T_map_sensor))
    return told


def wrong_frames(points: Points, T_map_sensor: Matrix) -> Iterator[tuple[str, Points]]:
    """A scan in the map's frame, where that is not nearly its own, and in a frame 10 m away."""
    if np.linalg.norm(T_map_sensor[:3, 3]) > FAR_M:
        yield "in the map's frame", transform_points(T_map_sensor, points).astype(np.float32)
    yield "in a frame 10 m away", points + np.float32(OFFSET_M)


def main(arguments: Sequence[str]) -> int:
    """Run the drill."""
    parser = argparse.ArgumentParser(
        prog="firstfix-lab half_turns",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--places", default=",".join((*PLACES, OFFICE)), help="names, with commas")
    parser.add_argument("--scans", type=int, metavar="N", help="of each place, drawn by chance; default: all")
    folder = parser.add_mutually_exclusive_group()
    folder.add_argument("--work", type=Path, default=WORK)
    folder.add_argument("--built", type=Path, help="folder of PLACE/version, which nothing is built in")
    given = parser.parse_args(arguments)
    failures: list[str] = []
    for name in given.places.split(","):
        work = (given.built or given.work) / name
        if name == OFFICE:
            failures += _ask_moved(work, is_built=given.built is not None)
            continue
        place = PLACES[name]
        if not place.available:
            print(f"{place.path} is not there")
            return 2
        localizer = _built(work) if given.built else _build(place, work)
        scans = scans_of(place)
        if given.scans is not None:
            scans = random.Random(SEED).sample(scans, min(given.scans, len(scans)))
        told = ask(localizer, scans)
        print("\n".join(_windows_table(name, told)), flush=True)
        failures += _failures(name, told)
    print("\n".join(failures) or "all as it must be")
    return int(bool(failures))


def scans_of(place: Dataset) -> list[tuple[Points, Matrix]]:
    """The held-out scans of a place, (n, 3) in the sensor frame, and T_map_sensor."""
    with tempfile.TemporaryDirectory() as folder:
        rows = read_poses_csv(place.write_queries(Path(folder) / "poses.csv"))
    return [
        (read_scan_file(row.path).points, row.T_map_sensor) for row in rows if row.T_map_sensor is not None
    ]


def _built(work: Path) -> Localizer:
    return Localizer(MapIndex.load(work / "version"))


def _build(place: Dataset, work: Path) -> Localizer:
    work.mkdir(parents=True, exist_ok=True)
    trajectory = place.write_trajectory(work / "trajectory.csv")
    build_version(place.map_path, BuildConfig.parse(place.config), work, trajectory=trajectory)
    return _built(work)


def _windows_table(name: str, told: dict[int, list[Told]]) -> list[str]:
    header = (
        "window",
        "scans",
        "right first",
        "localized right",
        "ambiguous",
        "false",
        "turned away",
        "named",
    )
    rows = []
    for width_deg, of_width in told.items():
        others: dict[str, int] = {}
        for one in of_width:
            if one.reason and one.verdict is Verdict.REJECTED:
                others[one.reason] = others.get(one.reason, 0) + 1
        rows.append(
            (
                width_deg,
                len(of_width),
                sum(one.is_right_first for one in of_width),
                sum(one.is_right for one in of_width),
                sum(one.verdict is Verdict.AMBIGUOUS for one in of_width),
                sum(one.is_false for one in of_width),
                sum(one.turned_away for one in of_width),
                sum(one.named for one in of_width),
                ", ".join(f"{reason} {count}" for reason, count in sorted(others.items())),
            )
        )
    return ["", name, "", *table((*header, "rejected"), rows)]


def _failures(name: str, told: dict[int, list[Told]]) -> Iterator[str]:
    for width_deg, of_width in told.items():
        away = sum(one.turned_away for one in of_width)
        if away:
            yield f"{name}, {width_deg} degrees: {away} turned away as in a wrong frame"
        named = sum(one.named and one.is_right_first for one in of_width)
        if named:
            yield f"{name}, {width_deg} degrees: {named} named, with the right pose first"
        false = sum(one.is_false for one in of_width)
        if false:
            yield f"{name}, {width_deg} degrees: {false} localized at a wrong place"
    if name == HALL.name:
        share = float(np.mean([one.is_right for one in told[90]]))
        if share < HALL_AT_90:
            yield f"{name}, 90 degrees: {share:.2f} localized and right"


def _ask_moved(work: Path, *, is_built: bool) -> list[str]:
    """Ask for the office's scans in wrong frames. Returns which were localized, or not named."""
    world = make_world(OFFICE, seed=0)
    if not is_built:
        write_world(world, work / "world")
        config = BuildConfig.parse({"sensor": world.sensor.to_mapping()})
        source, trajectory = work / "world" / "map.ply", work / "world" / "trajectory.txt"
        build_version(source, config, work, trajectory=trajectory)
    localizer = _built(work)
    scans = [(one.scan.points, one.T_map_sensor) for one in world.queries if one.T_map_sensor is not None]
    counts: dict[tuple[str, int], list[int]] = {}
    failures = []
    for number, (points, T_map_sensor) in enumerate(scans):
        for width_deg in (FULL_DEG, *WIDTHS_DEG):
            for frame, moved in wrong_frames(window(points, width_deg, 0.0), T_map_sensor):
                answer = localizer.localize(Scan.from_points(np.ascontiguousarray(moved)))
                localized, named = answer.verdict is Verdict.LOCALIZED, is_named(answer)
                row = counts.setdefault((frame, width_deg), [0, 0, 0])
                for column, value in enumerate((1, localized, named)):
                    row[column] += value
                if width_deg == FULL_DEG and (localized or not named):
                    failures.append(f"office, scan {number} {frame}: {answer.verdict.value}, not named")
    rows = ((*key, *row) for key, row in counts.items())
    print(
        "\n".join(["", "office", "", *table(("moved", "window", "scans", "localized", "named"), rows)]),
        flush=True,
    )
    return failures
